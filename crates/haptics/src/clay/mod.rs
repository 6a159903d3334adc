//! Clay: material that deforms while it is touched, as the tick sees it.
//!
//! Data in: the newest [`DensityFrame`] of a simulation that runs elsewhere, at its own rate. Data
//! out: contacts, added to those with rigid obstacles, and the pull of a rope.
//!
//! ```text
//!  frame ──► probe: density, way out, virtual contact point ──► sum over the shell ──► residual ──► wrench of the clay
//!        └─► rope ──────────────────────────────────────────────────────────────────────────────► + pull
//! ```
//!
//! # Source
//! Guo2004, dynamic global volumetric model (density raster), painting tool (direction of the
//! force, virtual contact point), force extrapolation.

mod held;
mod residual;
mod rope;

pub use held::ClayForces;
pub(crate) use held::Held;
pub use rope::Rope;

use super::{CouplingMode, CouplingParameters, Parameters};
use vps::density::DensityFrame;
use vps::spatial::Pose;

/// Material in a scene.
#[derive(Clone, Debug)]
pub struct Clay {
    /// Where it stands.
    pub world_from_map: Pose,
    /// As it is before the first update, [made ready](DensityFrame::make_ready).
    pub frame: DensityFrame,
    /// α of the force extrapolation: share of the step at an update that is left one tick later,
    /// 0..1; 0 passes steps through.
    pub smoothing: f64,
    /// How a rope pulls.
    pub rope: Rope,
}

/// A tool that is less deep, in spacings of the nodes, was put down on the clay and does not start
/// inside of it.
pub const PUT_DOWN_SPACINGS: f64 = 0.1;

/// Share of a step that is left after one interval between updates, by default.
const LEFT_AFTER_UPDATE: f64 = 0.1;

/// A rope is so much softer than what holds the arm to the virtual tool, and pulls with this share
/// of the largest force.
const ROPE_SHARE_OF_COUPLING: f64 = 0.25;
const ROPE_N_PER_M_MAX: f64 = 500.0;
const ROPE_SHARE_OF_LIMIT: f64 = 0.5;

impl Clay {
    /// Material of which a new frame comes every `update_period_s`, with a rope that makes no arm
    /// unstable and always leaves force for the contact.
    pub fn new(
        world_from_map: Pose,
        frame: DensityFrame,
        update_period_s: f64,
        parameters: &Parameters,
    ) -> Self {
        let CouplingParameters { stiffness_n_per_m, bound_n_per_m, .. } = parameters.coupling;
        let rope = Rope {
            stiffness_n_per_m: (ROPE_SHARE_OF_COUPLING * stiffness_n_per_m.min(bound_n_per_m))
                .min(ROPE_N_PER_M_MAX),
            force_n: ROPE_SHARE_OF_LIMIT * parameters.limits.force_n,
        };
        Self {
            world_from_map,
            frame,
            smoothing: Self::smoothing_between(update_period_s, parameters.period_s),
            rope,
        }
    }

    /// The α with which nine tenths of a step are felt when the next update comes.
    pub fn smoothing_between(update_period_s: f64, tick_period_s: f64) -> f64 {
        LEFT_AFTER_UPDATE.powf(tick_period_s / update_period_s)
    }
}

impl CouplingMode {
    /// Whether clay can be felt in this coupling. Not in `constraint`: it stands on planes and has
    /// no contact force that could go on smoothly from one update of the clay to the next; each
    /// update would be felt as a jump.
    pub fn feels_clay(self) -> bool {
        self != Self::Constraint
    }
}

#[cfg(test)]
#[expect(
    clippy::disallowed_types,
    clippy::expect_used,
    clippy::indexing_slicing,
    reason = "test code"
)]
mod tests {
    use std::sync::Arc;

    use glam::{DQuat, DVec3};

    use super::*;
    use crate::testing::{parameters, skew_block, skew_scene};
    use vps::density::{Lattice, Raster};
    use vps::pointshell::shell::Shell;
    use vps::spatial::Wrench;

    const SPACING_M: f64 = 2e-3;

    /// Clay below z = `top_m` of its map.
    fn frame(sequence: u64, top_m: f64) -> DensityFrame {
        let origin_map = DVec3::splat(-20e-3);
        let lattice = Lattice { origin_map, spacing_m: SPACING_M, dims: [21; 3] };
        let mut raster = Raster::uniform(lattice, 0.0);
        for x in 0..21 {
            for y in 0..21 {
                for z in 0..21 {
                    let value_m = top_m - lattice.position([x, y, z]).z;
                    raster.values_m_mut()[lattice.index([x, y, z])] = value_m as f32;
                }
            }
        }
        raster.measure();
        let base = Arc::new(raster.clone());
        let mut frame =
            DensityFrame { sequence, base, region: raster, rope_map: None, is_leap: false };
        frame.make_ready(None).expect("sound");
        frame
    }

    fn scene_parameters() -> Parameters {
        let mut p = parameters();
        p.contact.stiffness_n_per_m = 700.0;
        p.coupling.stiffness_n_per_m = 900.0;
        p.limits.force_n = 6.0;
        p
    }

    fn clay() -> Clay {
        Clay::new(skew_block(), frame(1, 0.0), 0.04, &scene_parameters())
    }

    /// One point, off the tool's middle.
    fn shell() -> Shell {
        Shell::new(&[(DVec3::new(2e-3, 1e-3, -4e-3), DVec3::Z)], 1e-3)
    }

    /// The tool askew, with its point so deep in clay of top 0.
    fn body(depth_m: f64) -> Pose {
        let rotation = skew_block().rotation * DQuat::from_scaled_axis(DVec3::new(0.1, 0.2, 0.3));
        let arm = rotation * DVec3::new(2e-3, 1e-3, -4e-3);
        let point = skew_block().transform_point(DVec3::new(1e-3, -3e-3, -depth_m));
        Pose::new(rotation, point - arm)
    }

    /// The wrench of one point so deep.
    fn pushed(depth_m: f64) -> Wrench {
        let force = skew_block().rotation * DVec3::Z * (700.0 * depth_m);
        let arm = body(depth_m).rotation * DVec3::new(2e-3, 1e-3, -4e-3);
        Wrench::new(force, arm.cross(force))
    }

    fn assert_near(one: Wrench, other: Wrench) {
        let differs = one - other;
        assert!(
            differs.force.length() < 2e-4 && differs.torque.length() < 2e-6,
            "{one:?} and not {other:?}"
        );
    }

    #[test]
    fn a_rope_is_softer_than_the_coupling_and_leaves_half_of_the_force() {
        let mut p = scene_parameters();
        let rope = |p: &Parameters| Clay::new(skew_block(), frame(1, 0.0), 0.04, p).rope;
        assert_eq!(rope(&p), Rope { stiffness_n_per_m: 225.0, force_n: 3.0 });
        p.coupling.bound_n_per_m = 500.0;
        assert_eq!(rope(&p).stiffness_n_per_m, 125.0);
        p.coupling = CouplingParameters { stiffness_n_per_m: 1e5, ..CouplingParameters::PLAIN };
        assert_eq!(rope(&p).stiffness_n_per_m, 500.0);
        // Nine tenths of a step are felt after 40 ticks.
        assert!((clay().smoothing.powi(40) - 0.1).abs() < 1e-12);
        for mode in [CouplingMode::Implicit, CouplingMode::Direct] {
            assert!(mode.feels_clay());
        }
        assert!(!CouplingMode::Constraint.feels_clay());
    }

    #[test]
    fn clay_pushes_a_point_out_along_its_surface_s_normal_by_its_depth() {
        let clay = clay();
        let shell = shell();
        let p = scene_parameters();
        let mut held = Held::new(&clay, &shell);
        for depth_m in [0.3e-3, 0.8e-3] {
            let sum = held.touch(&clay, &shell, body(depth_m), &p);
            assert_near(sum.wrench, pushed(depth_m));
            let forces = held.forces();
            assert_eq!((forces.contact_world, forces.contacts), (sum.wrench, 1));
            assert_eq!(forces.rope_world, DVec3::ZERO);
        }
        let free = held.touch(&clay, &shell, body(-1e-3), &p);
        assert_eq!((free.wrench, free.contacts, free.acts()), (Wrench::ZERO, 0, false));
    }

    #[test]
    fn a_tool_is_inside_from_a_tenth_of_a_spacing_on() {
        let clay = clay();
        let shell = shell();
        let p = scene_parameters();
        let mut held = Held::new(&clay, &shell);
        for (depth_m, inside) in [(0.19e-3, false), (0.21e-3, true), (2e-3, true), (-1e-3, false)] {
            assert_eq!(held.is_inside(&clay, &shell, body(depth_m), &p), inside, "{depth_m}");
        }
    }

    #[test]
    fn what_a_new_frame_changes_comes_in_by_the_average_and_a_leap_more_slowly() {
        let clay = clay();
        let shell = shell();
        let p = scene_parameters();
        let mut held = Held::new(&clay, &shell);
        assert_eq!(held.sequence(), 1);
        held.touch(&clay, &shell, body(0.3e-3), &p);
        // The surface rises by 1 mm.
        held.exchange(Box::new(frame(2, 1e-3)));
        assert_eq!(held.sequence(), 2);
        let now = pushed(0.3e-3) * (1.3 / 0.3);
        let step = pushed(0.3e-3) - now;
        for n in 1..4 {
            let felt = held.touch(&clay, &shell, body(0.3e-3), &p).wrench;
            assert_near(felt, now + step * clay.smoothing.powi(n));
        }
        held.at_rest();
        assert_near(held.touch(&clay, &shell, body(0.3e-3), &p).wrench, now);
        // A leap back, in a frame that no tick has touched before the next one came.
        let leap = DensityFrame { is_leap: true, ..frame(3, 0.0) };
        assert_eq!(held.exchange(Box::new(leap)).sequence, 1);
        assert_eq!(held.exchange(Box::new(frame(4, 0.0))).sequence, 3);
        let slow = Clay::smoothing_between(0.3, p.period_s);
        for n in 1..4 {
            let felt = held.touch(&clay, &shell, body(0.3e-3), &p).wrench;
            assert_near(felt, pushed(0.3e-3) - step * slow.powi(n));
        }
        // Touched, so the next one goes on from it.
        assert_eq!(held.exchange(Box::new(frame(5, 1e-3))).sequence, 2);
        // And as usual: a leap that was touched is over.
        held.at_rest();
        let felt = held.touch(&clay, &shell, body(0.3e-3), &p).wrench;
        assert_near(felt, now + step * clay.smoothing);
    }

    #[test]
    fn a_rope_pulls_to_its_anchor_which_is_averaged_and_lets_go() {
        let clay = clay();
        let shell = shell();
        let p = scene_parameters();
        let mut held = Held::new(&clay, &shell);
        let one = DVec3::new(5e-3, 2e-3, 4e-3);
        let other = DVec3::new(1e-3, 6e-3, 9e-3);
        let roped =
            |sequence, anchor| DensityFrame { rope_map: Some(anchor), ..frame(sequence, 0.0) };
        let away = body(-8e-3);
        let pull = |anchor: DVec3| {
            let stretch = skew_block().transform_point(anchor) - away.translation;
            stretch.normalize() * (3.0 * (225.0 * stretch.length() / 3.0).tanh())
        };
        held.exchange(Box::new(roped(2, one)));
        for _ in 0..2 {
            let sum = held.touch(&clay, &shell, away, &p);
            assert!((held.forces().rope_world - pull(one)).length() < 1e-12);
            assert!((sum.wrench.force - pull(one)).length() < 1e-12 && sum.acts());
            assert_eq!((sum.wrench.torque, sum.contacts), (DVec3::ZERO, 0));
            let stretch = skew_block().transform_point(one) - away.translation;
            let secant = pull(one).length() / stretch.length();
            let (force, torque) = sum.stiffness.mul(DVec3::new(1.0, -2.0, 3.0), DVec3::ONE);
            assert!((force - DVec3::new(1.0, -2.0, 3.0) * secant).length() < 1e-9);
            assert_eq!(torque, DVec3::ZERO);
        }
        held.exchange(Box::new(roped(3, other)));
        let mut felt = one;
        for _ in 0..3 {
            held.touch(&clay, &shell, away, &p);
            felt += (other - felt) * (1.0 - clay.smoothing);
            assert!((held.forces().rope_world - pull(felt)).length() < 1e-12);
        }
        held.at_rest();
        held.touch(&clay, &shell, away, &p);
        assert!((held.forces().rope_world - pull(other)).length() < 1e-12);
        held.let_go();
        let sum = held.touch(&clay, &shell, away, &p);
        assert!(held.forces().rope_world == DVec3::ZERO && !sum.acts());
    }

    #[test]
    fn a_state_tells_of_its_clay_and_of_whether_it_is_felt() {
        let mut p = scene_parameters();
        p.mapping.start = body(0.3e-3);
        let mut scene = skew_scene(p);
        scene.obstacles.clear();
        scene.tool.shell = shell();
        assert_eq!(crate::State::new(&scene).frame_sequence(), None);
        let mut builder = crate::SceneBuilder::new(p);
        builder.set_clay(clay());
        let built = vps::part::Part::of_shape(
            "tool",
            &vps::mesh::primitives::Shape::Sphere { radius_m: 5e-3 },
            2e-3,
        );
        let options = crate::ToolOptions::new(0.1);
        let (with_clay, _) =
            builder.finish(&built, &vps::voxmap::Options::new(2e-3), &options).expect("small");
        scene.clay = with_clay.clay;
        let mut state = crate::State::new(&scene);
        assert_eq!((state.frame_sequence(), state.feels_clay()), (Some(1), false));
        let mut input = crate::TickInput::default();
        crate::tick(&scene, &mut state, &input);
        assert_eq!((state.clay_forces().contacts, state.feels_clay()), (1, false));
        input.request = crate::DriveRequest::Enable;
        input.sample.status = vps::spatial::SampleStatus::Fresh;
        crate::tick(&scene, &mut state, &input);
        assert!(state.feels_clay());
        assert_eq!(state.exchange(Box::new(frame(7, 0.0))).sequence, 1);
        assert_eq!(state.frame_sequence(), Some(7));
    }
}
