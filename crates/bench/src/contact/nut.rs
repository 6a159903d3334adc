//! The M16 nut on its bolt: one contact query beside Coal, parry and Embree. By the clock on the
//! wall, as peers measure themselves.

use glam::{DQuat, DVec3};

use super::super::peers::{Peer, Peers};
use super::super::statistics::median;
use super::super::{BenchError, Row};
use super::speed::{Asking, name};
use super::{Options, fixture};
use rt::clock::monotonic_ns;
use vps::contact::TraversalMode;
use vps::mesh;
use vps::pointshell::Points;
use vps::spatial::Pose;

/// Where nut and bolt stand: the nut's mesh lies at 16 to 29 mm along the bolt's axis, as the
/// thread has it, and is lifted until flanks touch.
const LIFT_M: f64 = 2e-4;
const BOLT: &str = "factory_bolt_m16_tight.obj";
const NUT: &str = "factory_nut_m16_tight_subdiv_3x.obj";
const GROUP: &str = "M16 nut on its bolt: 25,672 with 15,078 triangles";

pub(super) fn rows(options: &Options, tell: &mut dyn FnMut(&str)) -> Result<Vec<Row>, BenchError> {
    let skipped = |why: String| Ok(vec![Row::new(GROUP, format!("skipped: {why}"), None, "")]);
    if options.quick {
        return skipped("--quick".to_owned());
    }
    let Some(folder) = &options.models else { return skipped("HAPTICD_MODELS not set".to_owned()) };
    let [bolt_path, nut_path] = [BOLT, NUT].map(|name| folder.join(name));
    let (bolt, nut) = match (mesh::load(&bolt_path, 1.0), mesh::load(&nut_path, 1.0)) {
        (Ok(bolt), Ok(nut)) => (bolt, nut),
        (Err(error), _) | (_, Err(error)) => return skipped(error.to_string()),
    };
    tell("nut on bolt");
    let obstacles = [fixture::obstacle(BOLT, &bolt, 2e-4, false)?];
    // At least 20,000 points, of the kind that scenes have by default.
    let shell = fixture::shell_of(NUT, &nut, 4e-4, Points::default())?;
    // The poses of the peers.
    let turned =
        |turn: u32| Pose::new(DQuat::from_rotation_z(0.01 * f64::from(turn)), DVec3::Z * LIFT_M);
    let path: Vec<Pose> = (0..11).map(turned).collect();
    let mut flat = Asking::new(TraversalMode::Flat, &obstacles, &shell);
    let contacts: Vec<f64> = path.iter().map(|pose| f64::from(flat.ask(*pose).contacts)).collect();
    let mut rows = vec![Row::new(GROUP, "points in contact, median", median(&contacts), "")];
    let peers = Peers::new(options.peers.clone(), 1);
    let figures = [Peer::Coal, Peer::CoalFirst, Peer::Parry, Peer::Embree].map(|peer| {
        tell(&format!("nut on bolt: {}", peer.name()));
        (peer, peers.contacts_ms(peer, &bolt_path, &nut_path, LIFT_M, shell.len()))
    });
    for mode in [TraversalMode::Tree, TraversalMode::Flat] {
        let mut asking = Asking::new(mode, &obstacles, &shell);
        let median_ms = median(&asking.times_us(&path, monotonic_ns, options)).map(|us| us * 1e-3);
        for (peer, figure) in &figures {
            let row = Row::new(
                GROUP,
                format!("{}, {} points: one query, median", name(mode), shell.len()),
                median_ms,
                "ms",
            );
            let row = row.beside_peer(&peer.name(), figure);
            // What a tick does is the walk. A first contact says no force.
            let is_asked = mode == TraversalMode::Tree && *peer != Peer::CoalFirst;
            rows.push(if is_asked { row.at_least_times(1000.0) } else { row });
        }
    }
    Ok(rows)
}
