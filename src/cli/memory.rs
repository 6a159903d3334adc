//! `--max-memory`, and what is said of memory before a bake.

use super::progress::BakeProgress;
use super::{OutputOptions, output, report};
use crate::scene::MemoryPlan;
use vps::storage::memory::available_bytes;
use vps::voxmap::estimate::Estimate;
use vps::voxmap::memory_limit::show_bytes;

/// How much memory baking may take.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct MemoryArgs {
    /// Refuse to bake what would hold more memory than this, such as 800M, 2GB or 1.5GiB. What the
    /// bake cache has is not baked.
    #[arg(long = "max-memory", value_name = "SIZE", value_parser = parse_size, allow_hyphen_values = true)]
    max_bytes: Option<u64>,
}

impl MemoryArgs {
    /// The limit, and what is said of each object before its work begins.
    fn plan<'a>(&self, progress: &'a BakeProgress, output: OutputOptions) -> MemoryPlan<'a> {
        let max_bytes = self.max_bytes;
        MemoryPlan::new(max_bytes, move |name, estimate| {
            tell(name, estimate, progress, output);
            warn(name, estimate, max_bytes, progress, output);
        })
    }

    /// The same, and what may not fit into the machine's memory is refused, not only warned of:
    /// beside force, as to be ended by the system leaves the last command to an arm; and for scenes
    /// that come from elsewhere.
    fn plan_within<'a>(
        &self,
        left: fn() -> Option<u64>,
        progress: &'a BakeProgress,
        output: OutputOptions,
    ) -> MemoryPlan<'a> {
        MemoryPlan::new(self.max_bytes, move |name, estimate| {
            tell(name, estimate, progress, output)
        })
        .within(left)
    }
}

/// What a bake may take.
#[derive(Clone, Copy, Debug)]
pub(crate) enum MemoryRule<'a> {
    /// All that it takes.
    Unlimited,
    /// What `--max-memory` says, see [`MemoryArgs::plan`].
    Given(&'a MemoryArgs),
    /// That, and no more than the machine has left, see [`MemoryArgs::plan_within`].
    Left(&'a MemoryArgs),
}

impl MemoryRule<'_> {
    pub(super) fn plan<'p>(
        self,
        progress: &'p BakeProgress,
        output: OutputOptions,
    ) -> MemoryPlan<'p> {
        match self {
            Self::Unlimited => MemoryPlan::unlimited(),
            Self::Given(args) => args.plan(progress, output),
            Self::Left(args) => args.plan_within(available_bytes, progress, output),
        }
    }
}

/// Estimates from here on are reported without being asked for.
const LARGE_BYTES: u64 = 256 << 20;

/// Units of a size, with their length in bytes.
const UNITS: [(&str, f64); 13] = [
    ("b", 1.0),
    ("k", 1e3),
    ("kb", 1e3),
    ("kib", 1024.0),
    ("m", 1e6),
    ("mb", 1e6),
    ("mib", 1_048_576.0),
    ("g", 1e9),
    ("gb", 1e9),
    ("gib", 1_073_741_824.0),
    ("t", 1e12),
    ("tb", 1e12),
    ("tib", 1_099_511_627_776.0),
];

/// Reads a size such as `800M`, `2GB` (powers of ten) or `1.5GiB` (powers of two). A bare number is
/// refused: a missing unit is the mistake that a unit would have caught.
fn parse_size(text: &str) -> Result<u64, String> {
    let trimmed = text.trim();
    let size = trimmed.find(|c: char| !(c.is_ascii_digit() || c == '.')).and_then(|unit_at| {
        let (number, unit) = trimmed.split_at(unit_at);
        let unit = unit.trim_start().to_ascii_lowercase();
        let (_, bytes_per_unit) = UNITS.into_iter().find(|(name, _)| *name == unit)?;
        // Saturates far beyond any machine.
        Some((number.parse::<f64>().ok()? * bytes_per_unit) as u64)
    });
    size.filter(|size| *size > 0).ok_or_else(|| {
        format!(
            "`{text}` is not a size: write a number and a unit (M, G or MB, GB; MiB, GiB), \
            such as 800M, 2GB or 1.5GiB"
        )
    })
}

/// Says what an object will take: when it is much, or when asked to say more.
fn tell(name: &str, estimate: &Estimate, progress: &BakeProgress, output: OutputOptions) {
    if !output.quiet && (output.verbose > 0 || estimate.peak_bytes > LARGE_BYTES) {
        progress.aside(|| {
            output::message(format_args!(
                "memory: {name} takes about {} ({} voxels in the box, about {} on the surface)\n",
                show_bytes(estimate.peak_bytes),
                estimate.voxels,
                estimate.surface_voxels,
            ));
        });
    }
}

/// Warns of more than the machine has left, unless a limit was given.
fn warn(
    name: &str,
    estimate: &Estimate,
    max_bytes: Option<u64>,
    progress: &BakeProgress,
    output: OutputOptions,
) {
    if let Some(text) = scarce_text(name, estimate).filter(|_| max_bytes.is_none()) {
        progress.aside(|| report::warning(&text, output));
    }
}

/// What is said of a part that takes more than the machine has left.
pub(super) fn scarce_text(name: &str, estimate: &Estimate) -> Option<String> {
    let available_bytes = available_bytes().filter(|available| estimate.peak_bytes > *available)?;
    let needed = show_bytes(estimate.peak_bytes);
    let available = show_bytes(available_bytes);
    Some(format!(
        "{name}: baking takes about {needed} and this machine has {available} left: it may be slow \
            or be ended by the system; use larger voxels or fewer layers, or --max-memory to \
            refuse"
    ))
}

#[cfg(test)]
mod tests {
    use super::super::When;
    use super::super::output::LogFormat;
    use super::*;
    use crate::scene::cache::{Cache, CachePolicy};
    use crate::scene::{self, BakeOptions, SceneError};
    use vps::part::PartError;
    use vps::storage::memory;
    use vps::voxmap::grid::GridError;
    use vps::voxmap::memory_limit::{FREE_BYTES, MemoryLimit};

    #[test]
    fn a_scene_that_the_machine_has_no_room_for_is_refused_before_it_is_baked_and_not_taken_from_the_cache()
     {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("scene.toml");
        let shape = "shape = { box_mm = [20.0, 20.0, 20.0] }\nvoxel_size_mm = 0.5\n";
        std::fs::write(
            &path,
            format!("version = 1\n[[static]]\nname = \"base\"\n{shape}[tool]\n{shape}"),
        )
        .expect("written");
        let config = crate::config::load(&path).unwrap_or_else(|errors| panic!("{errors}"));
        let output = OutputOptions {
            verbose: 0,
            quiet: true,
            color: When::Never,
            log_format: LogFormat::Text,
        };
        let build = |left: fn() -> Option<u64>, max_bytes: Option<u64>| {
            let progress = BakeProgress::new(output);
            let mut cache = Cache::at(folder.path().join("cache"), CachePolicy::Copy);
            let args = MemoryArgs { max_bytes };
            let mut options = BakeOptions {
                cache: &mut cache,
                memory: args.plan_within(left, &progress, output),
            };
            let mut n_baked = 0;
            let built = scene::build_with(&config, &mut options, |event| {
                n_baked += usize::from(event.stage == vps::voxmap::BakeStage::Surface)
            });
            (built.map(drop), n_baked)
        };
        let scarce: fn() -> Option<u64> = || Some(FREE_BYTES + (1 << 20));
        let refused = |(built, n_baked): (Result<(), SceneError>, usize)| {
            let error = built.expect_err("a mebibyte is not enough");
            let is_memory = matches!(
                &error,
                SceneError::Part(PartError::Grid {
                    source: GridError::Memory { limit: MemoryLimit::Left(_), .. },
                    ..
                })
            );
            assert!(is_memory && n_baked == 0, "{error}, {n_baked} baked");
            assert!(
                error.to_string().contains("are left")
                    && error.hint().is_some_and(|hint| hint.contains("end programs")),
                "{error}"
            );
        };
        refused(build(scarce, None));
        refused(build(scarce, Some(1 << 40)));
        assert!(matches!(
            build(|| Some(1 << 40), Some(1000)).0,
            Err(SceneError::Part(PartError::Grid {
                source: GridError::Memory { limit: MemoryLimit::Given(1000), .. },
                ..
            }))
        ));
        assert!(build(memory::available_bytes, None).0.is_ok());
        // What the cache has by now takes room as well.
        refused(build(|| Some(FREE_BYTES + 3000), None));
        assert!(build(|| None, None).0.is_ok());
    }

    #[test]
    fn sizes_in_both_systems_are_read_and_anything_else_is_refused() {
        for (text, bytes) in [
            ("800M", 800_000_000),
            ("2G", 2_000_000_000),
            ("2gb", 2_000_000_000),
            ("1.5GiB", 1_610_612_736),
            ("512 MiB", 536_870_912),
            ("64kib", 65_536),
            ("1T", 1_000_000_000_000),
            ("4096B", 4096),
        ] {
            assert_eq!(parse_size(text), Ok(bytes), "{text}");
        }
        for text in ["", "2", "G", "-1G", "1..5G", "2Gi", "2 GiB/s", "0M", "NaN", "1e9B"] {
            let error = parse_size(text).expect_err(text);
            assert!(error.contains("800M"), "{error}");
        }
    }
}
