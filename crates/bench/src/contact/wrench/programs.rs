//! The programs that answer: hapticd in three settings, peers through their scripts, and whatever
//! CSVs others have put there.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use super::super::super::peers::Peers;
use super::super::super::process;
use super::files::{self, About, PART, POSES, TOOL};
use super::scenes::PRESSURE_N_PER_M3;
use crate::BenchError;

/// Voxels of both parts, mm.
const VOXEL_MM: f64 = 0.2;

/// hapticd with some keys of a scene.
pub(super) struct Setting {
    pub(super) name: &'static str,
    /// Keys of `[tool]`, and tables.
    keys: [&'static str; 2],
    about: &'static str,
}

pub(super) const SETTINGS: [Setting; 2] = [
    Setting { name: "hapticd", keys: ["", ""], about: "facets, trilinear" },
    Setting {
        name: "raw VPS of 2008",
        keys: ["points = \"voxels\"\n", "[rendering]\nfield = \"layers\"\n"],
        about: "a point for each voxel, layers of voxels, all points along their own normals",
    },
];

/// Peers, and their scripts in the folder `adapters`: each is called with a scene's folder, its
/// poses and where to write the wrenches, and prints a line of JSON.
pub(super) const PEERS: [(&str, &str); 5] = [
    ("Drake", "drake_hydroelastic.py"),
    ("MuJoCo", "mujoco_sdf.py"),
    ("Coal", "coal_penalty.py"),
    ("Coal, first contact", "coal_first_contact.py"),
    ("Coal, distance", "coal_distance.py"),
];
const ADAPTERS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/adapters");

fn megabytes(bytes: Option<u64>) -> Option<f64> {
    bytes.map(|bytes| bytes as f64 * 1e-6)
}

/// Makes room for an answer: what an earlier run found is none of this one.
fn forget(out: &Path) -> Result<(), BenchError> {
    files::make_folder(out.parent().unwrap_or(out))?;
    match std::fs::remove_file(out) {
        Err(source) if source.kind() != ErrorKind::NotFound => {
            Err(BenchError::Write { path: out.to_owned(), source })
        }
        _ => Ok(()),
    }
}

fn write_about(out: &Path, about: &About) -> Result<(), BenchError> {
    let text = serde_json::to_string(about).map_err(|error| BenchError::Prepare {
        what: out.display().to_string(),
        why: error.to_string(),
    })?;
    files::write(out.with_extension("json"), &(text + "\n"))
}

/// Bakes and asks `hapticd`, on one thread.
pub(super) fn ask_hapticd(
    setting: &Setting,
    program: &Path,
    scene: &Path,
    out: &Path,
) -> Result<(), BenchError> {
    forget(out)?;
    let stiffness_n_per_mm3 = PRESSURE_N_PER_M3 * 1e-9;
    let [tool_keys, tables] = setting.keys;
    // JSON and TOML quote alike.
    let [part, tool] = [PART, TOOL]
        .map(|name| serde_json::Value::from(scene.join(name).to_string_lossy()).to_string());
    let text = format!(
        "version = 1\n[[static]]\nmesh = {part}\nunits = \"m\"\nvoxel_size_mm = \
            {VOXEL_MM}\n[tool]\nmesh = {tool}\nunits = \"m\"\nvoxel_size_mm = \
            {VOXEL_MM}\n{tool_keys}[device]\nprofile = \
            \"sim-sigma7\"\n[contact]\nstiffness_n_per_mm3 = {stiffness_n_per_mm3}\n{tables}"
    );
    let toml = out.with_extension("toml");
    files::write(toml.clone(), &text)?;
    let baked = process::run(process::hapticd(program).arg("bake").arg(&toml).args([
        "--json",
        "--quiet",
        "--cache",
        "off",
        "--threads",
        "1",
    ]))?;
    let mut eval = process::hapticd(program);
    eval.env("RAYON_NUM_THREADS", "1")
        .arg("eval")
        .arg(&toml)
        .args(["--quiet", "--cache", "off", "--poses"]);
    let (_, ended) = process::run_to_end(eval.arg(scene.join(POSES)).arg("--out").arg(out))?;
    let settings =
        format!("{}; voxels of {VOXEL_MM} mm, stiffness {PRESSURE_N_PER_M3:e} N/m³", setting.about);
    let peak = ended.peak_rss_bytes.max(baked.json["peak_rss_bytes"].as_u64());
    write_about(
        out,
        &About {
            settings,
            bake_s: baked.json["timings_s"]["total"].as_f64(),
            // All of the process: this errs in favour of the peers.
            memory_mb: megabytes(peak),
            not_measured: None,
        },
    )
}

/// Asks a peer, on one processor. Where it does not answer, the JSON file says why.
pub(super) fn ask_peer(
    script: &str,
    folder: Option<PathBuf>,
    scene: &Path,
    out: &Path,
) -> Result<(), BenchError> {
    forget(out)?;
    let ended = Peers::new(folder, 1)
        .script(&Path::new(ADAPTERS).join(script), &[scene, &scene.join(POSES), out]);
    let about = ended
        .and_then(|ended| serde_json::from_value(ended.json).map_err(|error| error.to_string()));
    let about = about.or_else(|why: String| {
        // Without the command line, which names folders of this machine.
        let not_measured =
            Some(why.rsplit_once(" failed: ").map_or(why.clone(), |(_, why)| why.to_owned()));
        // Where it stopped on the way.
        forget(out).map(|()| About { not_measured, ..About::default() })
    });
    write_about(out, &about?)
}
