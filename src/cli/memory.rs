//! `--max-memory`, and what is said of memory before a bake.

use super::progress::BakeProgress;
use super::{Talk, report, say};
use crate::scene::MemoryPlan;
use crate::voxmap::estimate::Estimate;
use crate::voxmap::grid::show_bytes;

/// How much memory baking may take.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct MemoryArgs {
    /// Refuse to bake what would hold more memory than this, such as 800M, 2GB or 1.5GiB. What the bake cache has is not baked.
    #[arg(long = "max-memory", value_name = "SIZE", value_parser = parse_size, allow_hyphen_values = true)]
    max_bytes: Option<u64>,
}

impl MemoryArgs {
    /// The limit, and what is said of each object before its work begins.
    pub(crate) fn plan<'a>(&self, progress: &'a BakeProgress, talk: Talk) -> MemoryPlan<'a> {
        let max_bytes = self.max_bytes;
        MemoryPlan::new(max_bytes, move |name, estimate| tell(name, estimate, max_bytes, progress, talk))
    }
}

/// Estimates from here on are told without being asked for.
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

/// Reads a size such as `800M`, `2GB` (powers of ten) or `1.5GiB` (powers of two). A bare number is refused: a missing unit is the
/// mistake that a unit would have caught.
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
        format!("`{text}` is not a size: write a number and a unit (M, G or MB, GB; MiB, GiB), such as 800M, 2GB or 1.5GiB")
    })
}

/// Says what an object will take: when it is much, or when asked to say more. Warns of more than the machine has left, unless a limit
/// was given.
fn tell(name: &str, estimate: &Estimate, max_bytes: Option<u64>, progress: &BakeProgress, talk: Talk) {
    if !talk.quiet && (talk.verbose > 0 || estimate.peak_bytes > LARGE_BYTES) {
        progress.aside(|| {
            say::talk(format_args!(
                "memory: {name} takes about {} ({} voxels in the box, about {} on the surface)\n",
                show_bytes(estimate.peak_bytes),
                estimate.voxels,
                estimate.surface_voxels,
            ));
        });
    }
    if let Some(available_bytes) = available_bytes().filter(|available| max_bytes.is_none() && estimate.peak_bytes > *available) {
        let (needed, available) = (show_bytes(estimate.peak_bytes), show_bytes(available_bytes));
        progress.aside(|| {
            report::warning(
                &format!(
                    "{name}: baking takes about {needed} and this machine has {available} left: it may be slow or be ended by the \
                     system; use larger voxels or fewer layers, or --max-memory to refuse"
                ),
                talk,
            );
        });
    }
}

/// Memory that the machine can give without swapping; `None` where /proc does not say.
fn available_bytes() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    let kib: u64 = line.trim().trim_end_matches("kB").trim().parse().ok()?;
    Some(kib * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

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
