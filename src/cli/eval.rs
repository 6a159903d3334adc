//! `hapticd eval`: the contact wrench at each given tool pose; no device, no time, no filter, no
//! coupling, no limits.

use std::borrow::Cow;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::ValueEnum;
use glam::DVec3;

use super::error::{CliError, Outcome};
use super::memory::MemoryRule;
use super::{OutputOptions, cache, output, report};
use crate::config::{self, SceneConfig};
use crate::daemon::PrepareError;
use crate::error::Exit;
use crate::scene;
use crate::scene::Borders;
use crate::scene::cache::CachePolicy;
use document::poses::{self, TimedPose};
use haptics::RenderScene;
use vps::contact::{
    self, ContactSum, ForceLaw, Normalization, SimdLevel, Traversal, TraversalMode,
};
use vps::parallel;
use vps::spatial::Pose;
use vps::storage::whole_file::{self, Access, write_whole};
use vps::voxmap::field::FieldKind;

/// Poses that one task looks at: enough that its memory is soon paid for.
const POSES_PER_TASK: usize = 16;
/// Contacts that are listed for each pose at most.
const MOST_CONTACTS: usize = 1000;
/// Poses that are looked at before their lines are written.
const POSES_AT_A_TIME: usize = 4096;

/// Arguments of `hapticd eval`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Scene file.
    scene: PathBuf,
    /// Tool poses in the world: CSV with the header t_s,x_m,y_m,z_m,qx,qy,qz,qw, or x_mm,y_mm,z_mm.
    #[arg(long, value_name = "F.csv")]
    poses: PathBuf,
    /// Where to write the wrenches, or - for stdout: CSV, world axes, torque about the tool frame's
    /// origin.
    #[arg(long, value_name = "F.csv")]
    out: PathBuf,
    /// Field look-up instead of the scene's.
    #[arg(long, value_name = "FIELD")]
    field: Option<FieldChoice>,
    /// List up to 1000 contacts of each pose in a file, or - for stdout: CSV of points, normals,
    /// depths and weights, world axes.
    #[arg(long, value_name = "F.csv")]
    contacts_out: Option<PathBuf>,
    #[command(flatten)]
    cache: cache::CacheArgs,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum FieldChoice {
    Layers,
    SurfacePoint,
    Octant,
    Trilinear,
}

impl From<FieldChoice> for FieldKind {
    fn from(choice: FieldChoice) -> Self {
        match choice {
            FieldChoice::Layers => Self::Layers,
            FieldChoice::SurfacePoint => Self::SurfacePoint,
            FieldChoice::Octant => Self::Octant,
            FieldChoice::Trilinear => Self::Trilinear,
        }
    }
}

pub(crate) fn main(args: &Args, output: OutputOptions) -> Outcome {
    let mut config = config::load(&args.scene)?;
    if config.sculpt.is_some() {
        let path = args.scene.display();
        let scene = output::quoted(&args.scene);
        return Err(CliError::configuration(format_args!(
            "{path}: [sculpt]: `eval` knows rigid parts only"
        ))
        .hint(&*format!("clay has a force while it is worked: `hapticd sculpt {scene}`")));
    }
    if is_stdout(&args.out) && args.contacts_out.as_deref().is_some_and(is_stdout) {
        return Err(CliError::usage("--out - and --contacts-out -: stdout takes one of the two")
            .hint("name a file for the other one"));
    }
    // Before the work, not after it.
    let files = [Some(&args.out), args.contacts_out.as_ref()].into_iter().flatten();
    for path in files.filter(|path| !is_stdout(path)) {
        whole_file::check(path).map_err(|error| cannot_write(path, &error))?;
    }
    let poses = poses::read(&args.poses).map_err(CliError::asset)?;
    if let Some(field) = args.field {
        config.parameters.contact.field = field.into();
    }
    let memory = MemoryRule::Unlimited;
    let baked = args.cache.bake(CachePolicy::Mapped, memory, output, |options, progress| {
        scene::build_with(&config, options, |event| progress.tell(&event))
    });
    let (scene, reports) = baked.map_err(|error| PrepareError::of_scene(&config, error))?;
    report::bake_warnings(&reports, output);

    let mut law = scene.parameters.contact.force_law();
    law.normalization = Normalization::None;
    let borders = Borders::new(&config);
    write_to(&args.out, |file| write_wrenches(file, &scene, borders, law, &poses))?;
    if let Some(path) = &args.contacts_out {
        write_to(path, |file| write_contacts(file, &config, &scene, &poses))?;
    }
    Ok(Exit::Ok)
}

fn cannot_write(path: &Path, error: &io::Error) -> CliError {
    if is_stdout(path) {
        CliError::write("to stdout", error)
    } else {
        CliError::write(path.display(), error)
    }
}

fn is_stdout(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// Writes a file that appears whole, or to stdout. A reader of stdout that has seen enough is no
/// error.
fn write_to(
    path: &Path,
    contents: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), CliError> {
    let written = if is_stdout(path) {
        let mut stdout = BufWriter::new(io::stdout().lock());
        contents(&mut stdout).and_then(|()| stdout.flush())
    } else {
        write_whole(path, Access::Shared, |file| contents(file))
    };
    match written {
        Err(error) if !(is_stdout(path) && error.kind() == io::ErrorKind::BrokenPipe) => {
            Err(cannot_write(path, &error))
        }
        _ => Ok(()),
    }
}

/// Body axes (tool axes at the centre of mass) of a tool pose.
fn body(scene: &RenderScene, world_from_tool: Pose) -> Pose {
    world_from_tool * Pose::from_translation(scene.tool.center_of_mass_tool)
}

fn write_wrenches(
    file: &mut dyn Write,
    scene: &RenderScene,
    mut borders: Borders<'_>,
    law: ForceLaw,
    poses: &[TimedPose],
) -> io::Result<()> {
    writeln!(
        file,
        "t_s,fx_n,fy_n,fz_n,tx_nm,ty_nm,tz_nm,contacts,max_depth_m,clearance_m,query_ns"
    )?;
    // The kernels of the tick: the bits of the specification, wherever a pose is looked at.
    let ready =
        Traversal::new(SimdLevel::best(), TraversalMode::Tree, &scene.obstacles, &scene.tool.shell)
            .with_broad_phase(false);
    // A part of the poses at a time: a reader of a pipe gets lines early, and what is held does not
    // grow with the poses.
    for poses in poses.chunks(POSES_AT_A_TIME) {
        let found = parallel::map_with(
            poses.len(),
            POSES_PER_TASK,
            || ready.clone(),
            |traversal, idx| ask(traversal, scene, law, &poses[idx]),
        );
        let deep = parallel::map(poses.len(), POSES_PER_TASK, |idx| {
            if found[idx].0.depth_is_bound { deep_points(scene, &poses[idx]) } else { Vec::new() }
        });
        for (object_idx, _) in deep.iter().flatten() {
            borders.make(*object_idx).map_err(io::Error::other)?;
        }
        let deepest_m = parallel::map(poses.len(), POSES_PER_TASK, |idx| {
            let depths_m = deep[idx].iter().filter_map(|(object_idx, place_m)| {
                Some(borders.of(*object_idx)?.distance_m(*place_m, f64::INFINITY))
            });
            depths_m.fold(found[idx].0.max_value_m, f64::max)
        });
        for ((timed, (sum, query_ns)), deepest_m) in poses.iter().zip(&found).zip(deepest_m) {
            writeln!(file, "{}", line(scene, timed, sum, deepest_m, *query_ns))?;
        }
    }
    Ok(())
}

/// Points that are as deep as the field of an object knows depths: the number of the object, and
/// where they are in its mesh, m.
fn deep_points(scene: &RenderScene, timed: &TimedPose) -> Vec<(usize, DVec3)> {
    let mut points = Vec::new();
    for (object_idx, obstacle) in scene.obstacles.iter().enumerate() {
        let map_from_body = obstacle.world_from_map.inverse() * body(scene, timed.pose);
        let kind = scene.parameters.contact.field;
        contact::visit(&obstacle.field, kind, &scene.tool.shell, map_from_body, |touching| {
            if touching.depth_m >= obstacle.field.deepest_m() {
                let place_m = map_from_body.transform_point(touching.arm_body.as_dvec3());
                points.push((object_idx, place_m));
            }
        });
    }
    points
}

/// What the contact does at one pose, and how long it took to find it, ns.
fn ask(
    traversal: &mut Traversal,
    scene: &RenderScene,
    law: ForceLaw,
    timed: &TimedPose,
) -> (ContactSum, u128) {
    let world_from_body = body(scene, timed.pose);
    let since = Instant::now();
    let RenderScene { obstacles, tool, .. } = scene;
    let sum =
        ContactSum::with_clearance(traversal, obstacles, &tool.shell, world_from_body, law, None);
    (sum, since.elapsed().as_nanos())
}

/// The same as a line of CSV, with the depth of the deepest point, m; negative outside.
fn line(
    scene: &RenderScene,
    timed: &TimedPose,
    sum: &ContactSum,
    deepest_m: f64,
    query_ns: u128,
) -> String {
    let world_from_body = body(scene, timed.pose);
    let wrench = sum.wrench.moved(world_from_body.translation, timed.pose.translation);
    let [fx, fy, fz] = wrench.force.to_array();
    let [tx, ty, tz] = wrench.torque.to_array();
    let depth_m = deepest_m.max(0.0);
    let clearance_m = -deepest_m;
    format!(
        "{},{fx},{fy},{fz},{tx},{ty},{tz},{},{depth_m},{clearance_m},{query_ns}",
        timed.time_s, sum.contacts
    )
}

fn write_contacts(
    file: &mut dyn Write,
    config: &SceneConfig,
    scene: &RenderScene,
    poses: &[TimedPose],
) -> io::Result<()> {
    writeln!(file, "t_s,object,point,x_m,y_m,z_m,nx,ny,nz,depth_m,weight")?;
    let mut lines = Vec::new();
    for timed in poses {
        let world_from_body = body(scene, timed.pose);
        lines.clear();
        for (object, obstacle) in config.statics.iter().zip(&scene.obstacles) {
            let name = field(&object.name);
            let map_from_body = obstacle.world_from_map.inverse() * world_from_body;
            contact::visit(
                &obstacle.field,
                scene.parameters.contact.field,
                &scene.tool.shell,
                map_from_body,
                |touching| {
                    if lines.len() < MOST_CONTACTS {
                        let [x, y, z] = world_from_body
                            .transform_point(touching.pressed_body.as_dvec3())
                            .to_array();
                        let [nx, ny, nz] = world_from_body
                            .transform_vector(touching.normal_body.as_dvec3())
                            .to_array();
                        let point = touching.point_idx;
                        let depth_m = touching.depth_m;
                        // Of a facet that is immersed in part less counts.
                        let weight = touching.weight * (touching.mean_depth_m / depth_m);
                        lines.push(format!(
                            "{},{name},{point},{x},{y},{z},{nx},{ny},{nz},{depth_m},{weight}",
                            timed.time_s
                        ));
                    }
                },
            );
        }
        for line in &lines {
            writeln!(file, "{line}")?;
        }
    }
    Ok(())
}

/// A name as one field of CSV (RFC 4180).
fn field(name: &str) -> Cow<'_, str> {
    if name.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", name.replace('"', "\"\"")).into()
    } else {
        name.into()
    }
}

#[cfg(test)]
mod tests {
    use super::field;

    #[test]
    fn a_name_is_one_field_whatever_is_in_it() {
        assert_eq!(field("fixed gear"), "fixed gear");
        assert_eq!(field("plate, 3\" wide"), "\"plate, 3\"\" wide\"");
        assert_eq!(field("two\nlines"), "\"two\nlines\"");
    }
}
