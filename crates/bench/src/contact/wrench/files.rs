//! What other programs read and write: a folder for each scene, and a CSV of wrenches for each
//! program and scene.

use std::fmt::Write as _;
use std::fs;
use std::hash::Hasher as _;
use std::path::{Path, PathBuf};

use document::poses;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use twox_hash::XxHash3_64;
use vps::mesh::TriangleMesh;
use vps::spatial::Wrench;

use super::scenes::Scene;
use crate::BenchError;

pub(super) const PART: &str = "part.obj";
pub(super) const TOOL: &str = "tool.obj";
pub(super) const POSES: &str = "poses.csv";
const LAW: &str = "law.csv";
const COLUMNS: [&str; 6] = ["fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm"];

/// What a program says of itself, in the JSON file beside its wrenches.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct About {
    /// What was chosen, in words.
    pub(super) settings: String,
    /// Before the first query, s.
    pub(super) bake_s: Option<f64>,
    /// By what the process grew while it prepared a scene, MB.
    pub(super) memory_mb: Option<f64>,
    /// Why there are no wrenches.
    pub(super) not_measured: Option<String>,
}

/// What a program found at the poses of a scene: nothing where it has not answered.
#[derive(Debug, Default)]
pub(super) struct Answer {
    /// Empty where the program answers less than a wrench.
    pub(super) wrenches: Vec<Wrench>,
    /// Empty where the program does not say.
    pub(super) query_ns: Vec<f64>,
    pub(super) about: About,
}

pub(super) fn write(path: PathBuf, text: &str) -> Result<(), BenchError> {
    fs::write(&path, text).map_err(|source| BenchError::Write { path, source })
}

pub(super) fn make_folder(path: &Path) -> Result<(), BenchError> {
    fs::create_dir_all(path).map_err(|source| BenchError::Write { path: path.to_owned(), source })
}

/// Lengths to a nanometre: the same text whatever the last bits of a sine are.
fn obj(mesh: &TriangleMesh) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail, here and below.
    for at in &mesh.vertices {
        let _ = writeln!(text, "v {:.9} {:.9} {:.9}", at.x, at.y, at.z);
    }
    for corners in &mesh.triangles {
        let [a, b, c] = corners.map(|idx| idx + 1);
        let _ = writeln!(text, "f {a} {b} {c}");
    }
    text
}

impl Answer {
    /// Whether the scene was answered, be it by times alone.
    pub(super) fn is_there(&self) -> bool {
        !self.wrenches.is_empty() || !self.query_ns.is_empty()
    }
}

/// Writes meshes, poses and closed forms of a scene, and adds them to a hash.
pub(super) fn write_scene(
    folder: &Path,
    scene: &Scene,
    hash: &mut XxHash3_64,
) -> Result<(), BenchError> {
    make_folder(folder)?;
    let mut pose_lines = poses::HEADER.to_owned() + "\n";
    let mut law_lines = "t_s,trajectory,depth_m,fx_n,fy_n,fz_n,px_m,py_m,pz_m\n".to_owned();
    let mut n = 0;
    for trajectory in &scene.trajectories {
        for tick in &trajectory.ticks {
            let time_s = f64::from(n) * 1e-3;
            let at = tick.pose.translation;
            let q = tick.pose.rotation;
            let _ = writeln!(
                pose_lines,
                "{time_s:.3},{:.9},{:.9},{:.9},{:.9},{:.9},{:.9},{:.9}",
                at.x, at.y, at.z, q.x, q.y, q.z, q.w
            );
            let _ = write!(law_lines, "{time_s:.3},{},{:.9}", trajectory.name, tick.depth_m);
            let of_law = tick.law.map_or([DVec3::NAN; 2], |law| [law.force, law.point]);
            for value in of_law.into_iter().flat_map(|vector| vector.to_array()) {
                let _ = write!(law_lines, ",{value:.9}");
            }
            law_lines.push('\n');
            n += 1;
        }
    }
    let files =
        [(PART, obj(&scene.part)), (TOOL, obj(&scene.tool)), (POSES, pose_lines), (LAW, law_lines)];
    for (name, text) in files {
        hash.write(text.as_bytes());
        write(folder.join(name), &text)?;
    }
    Ok(())
}

/// Reads wrenches of one scene, and what stands beside them. No file, no wrenches.
pub(super) fn read_answer(path: &Path, n_poses: usize) -> Result<Answer, BenchError> {
    let refused =
        |path: &Path, why: String| BenchError::Prepare { what: path.display().to_string(), why };
    let read = |path: &Path| match fs::read_to_string(path) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        other => other.map(Some).map_err(|error| refused(path, error.to_string())),
    };
    let mut answer = Answer::default();
    let beside = path.with_extension("json");
    if let Some(text) = read(&beside)? {
        answer.about =
            serde_json::from_str(&text).map_err(|error| refused(&beside, error.to_string()))?;
    }
    let Some(text) = read(path)? else { return Ok(answer) };
    let refused = |why: String| refused(path, why);
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap_or_default().split(',').map(str::trim).collect();
    let column = |name: &str| header.iter().position(|column| *column == name);
    let query = column("query_ns");
    let has_times_alone = query.is_some() && COLUMNS.iter().all(|name| column(name).is_none());
    let mut places = [0; 6];
    for (place, name) in places.iter_mut().zip(COLUMNS).filter(|_| !has_times_alone) {
        *place = column(name).ok_or_else(|| {
            refused(format!("no column {name} in the first line; wanted: {}", COLUMNS.join(",")))
        })?;
    }
    for (idx, line) in lines.enumerate() {
        let fields: Vec<&str> = line.split(',').collect();
        let number = |place: usize| {
            let field = fields.get(place).copied().unwrap_or_default().trim();
            let value = field.parse::<f64>().ok().filter(|value| value.is_finite());
            value.ok_or_else(|| {
                refused(format!(
                    "line {}: `{field}` in column {} is not a finite number",
                    idx + 2,
                    header[place]
                ))
            })
        };
        answer.query_ns.extend(query.map(number).transpose()?);
        if has_times_alone {
            continue;
        }
        let mut values = [0.0; 6];
        for (value, place) in values.iter_mut().zip(places) {
            *value = number(place)?;
        }
        let [fx, fy, fz, tx, ty, tz] = values;
        answer.wrenches.push(Wrench::new(DVec3::new(fx, fy, fz), DVec3::new(tx, ty, tz)));
    }
    let n_lines = answer.wrenches.len().max(answer.query_ns.len());
    if n_lines != n_poses {
        return Err(refused(format!(
            "{n_lines} lines for {n_poses} poses; write one line for each pose"
        )));
    }
    Ok(answer)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_csv_of_another_program_is_read_or_refused_with_the_reason() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.csv");
        let read = |text: &str, n: usize| {
            fs::write(&path, text).unwrap();
            read_answer(&path, n).map_err(|error| error.to_string())
        };
        // Columns by name, in any order; the rest is left out.
        let found = read("fy_n,fx_n,fz_n,tx_nm,ty_nm,tz_nm,t_s\n2,1,3,4,5,6,0\n", 1).unwrap();
        assert_eq!(
            found.wrenches,
            [Wrench::new(DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, 5.0, 6.0))]
        );
        assert!(found.query_ns.is_empty() && found.about.bake_s.is_none());
        let times = read("t_s,query_ns\n0,7\n", 1).unwrap();
        assert!(times.wrenches.is_empty() && times.query_ns == [7.0] && times.is_there());
        let header = "t_s,fx_n,fy_n,fz_n,tx_nm,ty_nm,tz_nm\n";
        for (text, n, why) in [
            ("t_s,fx_n\n", 0, "no column fy_n"),
            (&format!("{header}0,1,2,3,4,5,NaN\n"), 1, "line 2: `NaN` in column tz_nm"),
            (&format!("{header}0,1,2\n"), 1, "column fz_n"),
            (&format!("{header}0,1,2,3,4,5,6\n"), 2, "1 lines for 2 poses"),
            ("query_ns\n7\n", 2, "1 lines for 2 poses"),
            ("query_ns,fx_n\n7,1\n", 1, "no column fy_n"),
        ] {
            let said = read(text, n).unwrap_err();
            assert!(said.contains(why) && said.contains("scene.csv"), "{said}");
        }
        assert!(read_answer(&folder.path().join("none.csv"), 1).unwrap().wrenches.is_empty());
        fs::write(folder.path().join("scene.json"), r#"{"settings": "none", "bake_s": 0.5}"#)
            .unwrap();
        assert_eq!(read(header, 0).unwrap().about.bake_s, Some(0.5));
    }
}
