//! Stand-ins for tests: the parameters of a scene without objects, and that scene.
#![expect(clippy::disallowed_types, reason = "test code outside the loop")]

use std::sync::Arc;

use glam::{DMat3, DVec3};
use vps::pointshell::shell::Shell;

use crate::{
    CouplingParameters, FilterParameters, Inertia, LimitParameters, Parameters, RenderScene, Tool,
};

/// Parameters of a 1 kHz scene with nothing in it.
pub fn parameters() -> Parameters {
    Parameters {
        coupling: CouplingParameters { stiffness_nm_per_rad: 0.3, ..CouplingParameters::PLAIN },
        filter: FilterParameters { cutoff_hz: [f64::INFINITY, f64::INFINITY] },
        limits: LimitParameters {
            force_n: 10.0,
            torque_nm: 0.2,
            speed_m_per_s: 1.0,
            slew_n_per_s: 1000.0,
            slew_nm_per_s: 20.0,
            power_w: 5.0,
            stall_s: 0.05,
            ..LimitParameters::NONE
        },
        ..Parameters::unlimited(1e-3)
    }
}

/// A scene without objects.
pub fn empty_scene() -> Arc<RenderScene> {
    let inertia = Inertia { mass_kg: 0.1, body_kg_m2: DMat3::IDENTITY * 1e-5, least_kg_m2: 1e-5 };
    Arc::new(untouched_scene(parameters(), inertia))
}

/// A scene without objects, with a tool of this inertia that has no points. The one place to extend
/// when `RenderScene` grows.
fn untouched_scene(parameters: Parameters, inertia: Inertia) -> RenderScene {
    let tool = Tool { shell: Shell::new(&[], 1e-3), inertia, center_of_mass_tool: DVec3::ZERO };
    RenderScene { parameters, obstacles: Vec::new(), clay: None, tool }
}

/// A scene in which an arm that takes damping is on a spring of this stiffness to a tool that
/// nothing moves.
#[cfg(test)]
pub(crate) fn spring_scene(stiffness_n_per_m: f64) -> RenderScene {
    let mut p = parameters();
    p.coupling.free_space = crate::FreeSpace::Drag;
    p.coupling.stiffness_n_per_m = stiffness_n_per_m;
    p.arm.injected_n_s_per_m = 20.0;
    p.arm.injected_nm_s_per_rad = 0.01;
    untouched_scene(p, Inertia { mass_kg: 1e7, body_kg_m2: DMat3::IDENTITY, least_kg_m2: 1.0 })
}

/// The wrench that a stiffness or a damping makes of a motion.
#[cfg(test)]
pub(crate) fn product(
    matrix: &vps::spatial::Mat6,
    twist: vps::spatial::Twist,
) -> vps::spatial::Wrench {
    let (force, torque) = matrix.mul(twist.linear, twist.angular);
    vps::spatial::Wrench::new(force, torque)
}

/// Where the obstacle of [`skew_scene`] stands.
#[cfg(test)]
pub(crate) fn skew_block() -> vps::spatial::Pose {
    let rotation = glam::DQuat::from_scaled_axis(DVec3::new(0.4, -0.9, 0.6));
    vps::spatial::Pose::new(rotation, DVec3::new(0.05, -0.02, 0.03))
}

/// The pose of the tool's axes at which the points of [`skew_scene`]'s tool are some 0.3 mm deep in
/// the block, raised along its face by `raised_m`.
#[cfg(test)]
pub(crate) fn skew_start(raised_m: f64) -> vps::spatial::Pose {
    let block = skew_block();
    let tilt = glam::DQuat::from_scaled_axis(DVec3::new(0.02, -0.03, 0.4));
    let at = DVec3::new(1e-3, 2e-3, 20e-3 + 5e-3 - 0.3e-3 + raised_m);
    vps::spatial::Pose::new(block.rotation * tilt, block.transform_point(at))
}

/// A tool of 24 points above a face of a block of 40 mm; no axis of the world is one of the
/// block's or of the tool's.
#[cfg(test)]
#[expect(clippy::disallowed_macros, clippy::expect_used, reason = "test code")]
pub(crate) fn skew_scene(parameters: Parameters) -> RenderScene {
    use std::sync::LazyLock;
    use vps::voxmap::{Options, field::Field};
    use vps::{contact::Obstacle, mesh::primitives::Shape, part::Part};

    static FIELD: LazyLock<Field> = LazyLock::new(|| {
        let shape = Shape::Box { size_m: DVec3::splat(40e-3) };
        let part = Part::of_shape("block", &shape, 1e-3);
        part.bake_field(&Options::new(1e-3), false, |_| ()).expect("a small grid").0
    });
    let rows = [-4.0, -4.0 / 3.0, 4.0 / 3.0, 4.0];
    let points: Vec<_> = [-6.0, -3.6, -1.2, 1.2, 3.6, 6.0]
        .into_iter()
        .flat_map(|x| rows.map(|y| (x, y)))
        .map(|(x, y)| {
            let normal = DVec3::new(-0.02 * x, -0.03 * y, 1.0).normalize();
            (DVec3::new(x, y, -5.0) * 1e-3, normal)
        })
        .collect();
    let body_kg_m2 = DMat3::from_diagonal(DVec3::new(2e-5, 5e-5, 9e-5));
    let inertia = Inertia { mass_kg: 0.3, body_kg_m2, least_kg_m2: 2e-5 };
    let tool = Tool { shell: Shell::new(&points, 1e-3), inertia, center_of_mass_tool: DVec3::ZERO };
    let obstacles = vec![Obstacle { field: FIELD.clone(), world_from_map: skew_block() }];
    RenderScene { parameters, obstacles, clay: None, tool }
}
