//! `hapticd eval`: the contact wrench at each given tool pose; no device, no time, no filter, no coupling, no limits.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

use super::progress::BakeProgress;
use super::{OutputOptions, cache, output, report};
use crate::config;
use crate::error::Exit;
use crate::scene::cache::CachePolicy;
use crate::scene::{self, BakeOptions};
use document::poses::{self, TimedPose};
use haptics::RenderScene;
use vps::contact::{ContactSum, ForceLaw, Normalization};
use vps::spatial::Pose;

/// Arguments of `hapticd eval`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Scene file.
    scene: PathBuf,
    /// Tool poses in the world: CSV with the header t_s,x_m,y_m,z_m,qx,qy,qz,qw.
    #[arg(long, value_name = "F.csv")]
    poses: PathBuf,
    /// Where to write the wrenches: CSV, world axes, torque about the tool frame's origin.
    #[arg(long, value_name = "F.csv")]
    out: PathBuf,
    #[command(flatten)]
    cache: cache::CacheArgs,
}

pub(crate) fn main(args: &Args, talk: OutputOptions) -> Exit {
    let config = match config::load(&args.scene) {
        Ok(config) => config,
        Err(errors) => return report::config_errors(&errors, talk),
    };
    if config.sculpt.is_some() {
        let path = args.scene.display();
        let hint = format!("clay has a force while it is worked: `hapticd sculpt {}`", output::quoted(&args.scene));
        report::error(&format!("{path}: [sculpt]: `eval` knows rigid parts only"), Some(&hint), talk);
        return Exit::Configuration;
    }
    let poses = match poses::read(&args.poses) {
        Ok(poses) => poses,
        Err(error) => {
            report::error(&error.to_string(), None, talk);
            return Exit::Asset;
        }
    };
    let mut cache = args.cache.open(CachePolicy::Mapped, talk);
    let progress = BakeProgress::new(talk);
    let baked = scene::build_with(&config, &mut BakeOptions::from(&mut cache), |event| progress.tell(&event));
    progress.finish();
    cache::tell(&mut cache, talk);
    let (scene, reports) = match baked {
        Ok(baked) => baked,
        Err(error) => return report::scene_error(&error, talk),
    };
    report::bake_warnings(&reports, talk);

    let law = ForceLaw { normalization: Normalization::None, ..scene.parameters.contact.force_law(false) };
    match write_wrenches(&args.out, &scene, law, &poses) {
        Ok(()) => Exit::Ok,
        Err(error) => {
            report::error(&format!("cannot write {}: {error}", args.out.display()), None, talk);
            Exit::Asset
        }
    }
}

/// Body axes (tool axes at the centre of mass) of a tool pose.
fn body(scene: &RenderScene, world_from_tool: Pose) -> Pose {
    world_from_tool * Pose::from_translation(scene.tool.center_of_mass_tool)
}

fn write_wrenches(path: &Path, scene: &RenderScene, law: ForceLaw, poses: &[TimedPose]) -> io::Result<()> {
    let mut file = BufWriter::new(File::create(path)?);
    writeln!(file, "t_s,fx_n,fy_n,fz_n,tx_nm,ty_nm,tz_nm,contacts,max_depth_m,clearance_m,query_ns")?;
    for timed in poses {
        let world_from_body = body(scene, timed.pose);
        let since = Instant::now();
        let sum = ContactSum::flat(&scene.obstacles, &scene.tool.shell, world_from_body, law);
        let query_ns = since.elapsed().as_nanos();
        let wrench = sum.wrench.moved(world_from_body.translation, timed.pose.translation);
        let [fx, fy, fz] = wrench.force.to_array();
        let [tx, ty, tz] = wrench.torque.to_array();
        let (depth_m, clearance_m) = (sum.max_value_m.max(0.0), -sum.max_value_m);
        writeln!(file, "{},{fx},{fy},{fz},{tx},{ty},{tz},{},{depth_m},{clearance_m},{query_ns}", timed.time_s, sum.contacts)?;
    }
    file.flush()
}
