//! Where the obstacles stand now, which of them are near (the broad phase), and how they move from
//! tick to tick.
//!
//! An obstacle whose box of samples lies clear of a sphere around the whole tool is not asked in
//! that tick. All that is outside the box has the same V, so it is known what asking would have
//! given: the broad phase changes no bit of the specification's answer
//! ([`ContactSum::flat`](super::ContactSum::flat)).
//!
//! How long it stays so is remembered: the gap is used up by the way that the tool's centre goes
//! (turning moves no sphere about it) and by the obstacle's own moves. So an obstacle far away
//! costs one comparison per tick.
//!
//! # Source
//! A sphere against boxes is the commonest broad phase; the gap that motion uses up is that of
//! McNeely2006 for points.

#![expect(clippy::disallowed_types, reason = "sized when the scene is made ready, never resized")]

use glam::DVec3;

use super::Obstacle;
use crate::pointshell::shell::Shell;
use crate::spatial::Pose;
use crate::voxmap::field::brick_bounds::BrickBounds;

/// Way of the tool after which all gaps are measured anew, so that their sums stay exact, m.
const FORGET_M: f64 = 1e3;
/// By how much a box is grown for what rounding may do to a point beside it: so many voxels …
const GROWN_VOXELS: f64 = 1.0;
/// … and so much of its size.
const GROWN_SHARE: f64 = 1e-5;

/// What an obstacle far away costs.
#[derive(Clone, Copy, Debug)]
struct Far {
    /// Way of the tool at which the gap may be used up, m; −∞: near, or never known to be far.
    clear_until_m: f64,
    /// V of everything outside the box, m.
    outside_m: f32,
    voxel_size_m: f32,
}

/// One obstacle: where it stands, and its box.
#[derive(Clone, Copy, Debug)]
pub struct ObstaclePose {
    /// Its pose in this tick.
    pub world_from_map: Pose,
    /// What it moved by in this tick.
    pub moved: PoseStep,
    /// Middle of the box, map frame, m.
    pub center_map: DVec3,
    /// Half the edges of the box, m.
    half_m: DVec3,
    /// Farthest corner from the middle, m.
    pub reach_m: f64,
    /// Voxel edge, m.
    pub voxel_size_m: f64,
    /// What its points may go in the next tick, m; taken off the tool's step limit. 0 of what
    /// stands.
    pub reserve_m: f64,
    /// Largest V of this tick, m.
    pub max_value_m: f64,
    /// The deepest contact of this tick, in the world, and the unit direction in which it leaves
    /// the obstacle; found only while it moves.
    pub deepest_world: Option<(DVec3, DVec3)>,
    /// False where the box does not decide it.
    boxed: bool,
}

/// A small motion of an obstacle in one tick, world axes: its material at a point x goes by
/// `linear` + `angular` × (x − `center`).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PoseStep {
    /// The point that moves by `linear`, world axes, m.
    pub center: DVec3,
    /// Its displacement in the tick, m.
    pub linear: DVec3,
    /// Rotation in the tick, rad.
    pub angular: DVec3,
}

impl PoseStep {
    /// Nothing moves.
    pub fn is_none(&self) -> bool {
        self.linear == DVec3::ZERO && self.angular == DVec3::ZERO
    }

    /// What the material at a point goes by, m.
    pub fn at(&self, point: DVec3) -> DVec3 {
        self.linear + self.angular.cross(point - self.center)
    }
}

impl ObstaclePose {
    /// The middle of the box in the world.
    pub fn center_world(&self) -> DVec3 {
        self.world_from_map.transform_point(self.center_map)
    }

    /// How far a sphere is from the box, m; negative where they may meet.
    fn gap_m(&self, center_world: DVec3, radius_m: f64) -> f64 {
        let from_middle =
            self.world_from_map.inverse().transform_point(center_world) - self.center_map;
        (from_middle.abs() - self.half_m).max(DVec3::ZERO).length() - radius_m
    }
}

/// All obstacles of a scene.
#[derive(Clone, Debug)]
pub struct ObstaclePoses {
    far: Vec<Far>,
    poses: Vec<ObstaclePose>,
    /// Numbers of the near ones of this tick, rising.
    near: Vec<u32>,
    /// Σ|Δx| of the tool's centre, m.
    way_m: f64,
    last: Option<DVec3>,
    culls: bool,
}

impl ObstaclePoses {
    /// Cold. `all_bounds`: one per obstacle, `None` where the box does not bound what can touch.
    pub(super) fn new<'a>(
        obstacles: &[Obstacle],
        all_bounds: impl Iterator<Item = Option<&'a BrickBounds>>,
    ) -> Self {
        let poses: Vec<ObstaclePose> = obstacles
            .iter()
            .zip(all_bounds)
            .map(|(obstacle, bounds)| ObstaclePose::new(obstacle, bounds))
            .collect();
        Self {
            far: obstacles
                .iter()
                .zip(&poses)
                .map(|(obstacle, pose)| Far::new(obstacle, pose))
                .collect(),
            near: Vec::with_capacity(poses.len()),
            poses,
            way_m: 0.0,
            last: None,
            culls: true,
        }
    }

    /// Whether far ones are passed over; without, every one is asked, for comparison.
    pub(super) fn set_culling(&mut self, culls: bool) {
        self.culls = culls;
    }

    /// One obstacle.
    pub fn pose(&self, obstacle_idx: usize) -> Option<&ObstaclePose> {
        self.poses.get(obstacle_idx)
    }

    /// One obstacle.
    pub fn pose_mut(&mut self, obstacle_idx: usize) -> Option<&mut ObstaclePose> {
        self.poses.get_mut(obstacle_idx)
    }

    /// Puts an obstacle to a pose, of which `moved` is what is new; no point of its box goes by
    /// more than `way_m`. RT: safe.
    pub fn put(&mut self, obstacle_idx: usize, world_from_map: Pose, moved: PoseStep, way_m: f64) {
        if let (Some(pose), Some(far)) =
            (self.poses.get_mut(obstacle_idx), self.far.get_mut(obstacle_idx))
        {
            pose.world_from_map = world_from_map;
            pose.moved = moved;
            // A way that is not a number leaves nothing known.
            far.clear_until_m =
                if way_m >= 0.0 { far.clear_until_m - way_m } else { f64::NEG_INFINITY };
        }
    }

    /// Finds out which obstacles are near the tool at this pose. Returns what is to be noted of the
    /// others all together. RT: safe; one comparison for each obstacle that is known to be far.
    pub(super) fn look_around(
        &mut self,
        shell: &Shell,
        world_from_body: Pose,
        overstated_voxels: f64,
    ) -> FarSum {
        let center = world_from_body.translation;
        let step_m = self.last.replace(center).map_or(0.0, |last| (center - last).length());
        self.way_m += step_m;
        if self.way_m.is_nan() || self.way_m >= FORGET_M {
            self.way_m = 0.0;
            self.far.iter_mut().for_each(|far| far.clear_until_m = f64::NEG_INFINITY);
        }
        let culls = self.culls && world_from_body.is_finite() && !shell.is_empty();
        self.near.clear();
        let mut sum = FarSum::default();
        for ((obstacle_idx, far), pose) in (0..).zip(&mut self.far).zip(&mut self.poses) {
            if culls && far.clear_until_m <= self.way_m {
                let gap_m = if pose.boxed { pose.gap_m(center, shell.radius_m()) } else { -1.0 };
                far.clear_until_m =
                    if gap_m > 0.0 { self.way_m + gap_m } else { f64::NEG_INFINITY };
            }
            if !(culls && far.clear_until_m > self.way_m) {
                self.near.push(obstacle_idx);
                continue;
            }
            let outside_m = f64::from(far.outside_m);
            let voxel_size_m = f64::from(far.voxel_size_m);
            sum.max_value_m = sum.max_value_m.max(outside_m);
            sum.free_way_m = sum.free_way_m.min(far.clear_until_m - self.way_m);
            sum.voxel_size_m = sum.voxel_size_m.min(voxel_size_m);
            sum.step_limit_m = sum.step_limit_m.min(step_limit_m(
                outside_m,
                voxel_size_m,
                overstated_voxels,
                pose.reserve_m,
            ));
            if pose.reserve_m > 0.0 {
                (pose.max_value_m, pose.deepest_world) = (outside_m, None);
            }
        }
        sum
    }

    /// The n-th of those that are near.
    pub(super) fn near(&self, n: usize) -> Option<usize> {
        self.near.get(n).map(|obstacle_idx| *obstacle_idx as usize)
    }

    /// How many are near.
    pub(super) fn n_near(&self) -> usize {
        self.near.len()
    }
}

/// What obstacles far away add to a sum.
#[derive(Clone, Copy, Debug)]
pub(super) struct FarSum {
    pub(super) max_value_m: f64,
    pub(super) voxel_size_m: f64,
    pub(super) step_limit_m: f64,
    pub(super) free_way_m: f64,
}

impl Default for FarSum {
    fn default() -> Self {
        Self {
            max_value_m: f64::NEG_INFINITY,
            voxel_size_m: f64::INFINITY,
            step_limit_m: f64::INFINITY,
            free_way_m: f64::INFINITY,
        }
    }
}

/// What a point of the tool may go in one tick without passing unnoticed through an obstacle, whose
/// own points may go by up to `reserve_m` meanwhile, but for half of the clearance (a quarter of a
/// voxel is always theirs), m.
pub(super) fn step_limit_m(
    max_value_m: f64,
    voxel_size_m: f64,
    overstated_voxels: f64,
    reserve_m: f64,
) -> f64 {
    let clearance_m = -max_value_m - overstated_voxels * voxel_size_m;
    (clearance_m - reserve_m.min(OWN_SHARE * clearance_m.max(0.0))).max(0.5 * voxel_size_m)
}

/// The share of a clearance that an obstacle may use up in one tick by its own motion.
pub const OWN_SHARE: f64 = 0.5;

impl ObstaclePose {
    fn new(obstacle: &Obstacle, bounds: Option<&BrickBounds>) -> Self {
        let Obstacle { field, world_from_map } = obstacle;
        let voxel_size_m = f64::from(field.voxel_size_m());
        let size_m = bounds.map_or(DVec3::ZERO, |bounds| {
            DVec3::from_array(bounds.dims().map(f64::from)) * (8.0 * voxel_size_m)
        });
        let grown_m = GROWN_VOXELS * voxel_size_m + GROWN_SHARE * size_m.length();
        let half_m = 0.5 * size_m + DVec3::splat(grown_m);
        Self {
            world_from_map: *world_from_map,
            moved: PoseStep::default(),
            center_map: field.origin_map().as_dvec3() + 0.5 * size_m,
            half_m,
            reach_m: half_m.length(),
            voxel_size_m,
            reserve_m: 0.0,
            max_value_m: f64::NEG_INFINITY,
            deepest_world: None,
            boxed: bounds.is_some(),
        }
    }
}

impl Far {
    fn new(obstacle: &Obstacle, pose: &ObstaclePose) -> Self {
        let outside_m = obstacle.field.outside_m();
        Self { clear_until_m: f64::NEG_INFINITY, outside_m, voxel_size_m: pose.voxel_size_m as f32 }
    }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;
    use crate::contact::tests::plate;

    /// One point, ten millimetres aside.
    fn shell() -> Shell {
        Shell::new(&[(DVec3::X * 1e-2, DVec3::NEG_X)], 1e-3)
    }

    fn poses(obstacles: &[Obstacle]) -> ObstaclePoses {
        let bounds: Vec<Option<BrickBounds>> =
            obstacles.iter().map(|obstacle| BrickBounds::of(&obstacle.field)).collect();
        ObstaclePoses::new(obstacles, bounds.iter().map(Option::as_ref))
    }

    fn at(z_m: f64) -> Pose {
        Pose::from_translation(DVec3::Z * z_m)
    }

    #[test]
    fn a_gap_is_measured_once_and_used_up_by_the_way_of_the_tool_and_of_the_obstacle() {
        let plate = plate();
        let shell = shell();
        let mut poses = poses(core::slice::from_ref(&plate));
        let far = poses.look_around(&shell, at(1.0), 2.0);
        let gap_m = poses.poses[0].gap_m(DVec3::Z, shell.radius_m());
        assert_eq!((poses.n_near(), poses.far[0].clear_until_m), (0, gap_m));
        let outside_m = f64::from(plate.field.outside_m());
        let voxel_size_m = f64::from(plate.field.voxel_size_m());
        assert_eq!((far.max_value_m, far.voxel_size_m), (outside_m, voxel_size_m));
        assert_eq!(far.step_limit_m, step_limit_m(outside_m, voxel_size_m, 2.0, 0.0));
        // Half a metre away and as much back.
        for (z_m, way_m, clear_until_m) in [(1.5, 0.5, gap_m), (1.0, 1.0, 1.0 + gap_m)] {
            poses.look_around(&shell, at(z_m), 2.0);
            assert_eq!((poses.n_near(), poses.way_m), (0, way_m));
            // Used up by then, it is measured anew, from where the way is.
            assert_eq!(poses.far[0].clear_until_m, clear_until_m);
        }
        poses.put(0, plate.world_from_map, PoseStep::default(), 0.25);
        assert_eq!(poses.far[0].clear_until_m, 1.0 + gap_m - 0.25);
        poses.look_around(&shell, at(1.125), 2.0);
        assert_eq!((poses.way_m, poses.far[0].clear_until_m), (1.125, 1.0 + gap_m - 0.25));
        poses.put(0, plate.world_from_map, PoseStep::default(), f64::NAN);
        assert_eq!(poses.far[0].clear_until_m, f64::NEG_INFINITY);
        poses.look_around(&shell, at(0.0), 2.0);
        assert_eq!((poses.n_near(), poses.near(0), poses.near(1)), (1, Some(0), None));
    }

    #[test]
    fn gaps_are_forgotten_after_a_long_way_and_where_the_way_is_not_known() {
        let plate = plate();
        let shell = shell();
        let mut poses = poses(core::slice::from_ref(&plate));
        poses.look_around(&shell, at(1.0), 2.0);
        poses.look_around(&shell, at(1.0 + 2.0 * FORGET_M), 2.0);
        let gap_m = poses.poses[0].gap_m(at(1.0 + 2.0 * FORGET_M).translation, shell.radius_m());
        assert_eq!((poses.way_m, poses.far[0].clear_until_m), (0.0, gap_m));
        poses.look_around(&shell, at(f64::NAN), 2.0);
        assert_eq!((poses.way_m, poses.n_near()), (0.0, 1));
        poses.look_around(&shell, at(1.0), 2.0);
        assert_eq!((poses.way_m, poses.n_near()), (0.0, 0));
    }

    #[test]
    fn only_obstacles_that_are_far_for_sure_are_passed_over() {
        let plates = [Obstacle { world_from_map: at(-5.0), ..plate() }, plate()];
        let shell = shell();
        let mut poses = poses(&plates);
        poses.look_around(&shell, at(0.0), 2.0);
        assert_eq!((poses.n_near(), poses.near(0)), (1, Some(1)));
        // Turned by what is not a number.
        let turned = Pose::new(DQuat::from_xyzw(f64::NAN, 0.0, 0.0, 1.0), DVec3::Z);
        poses.look_around(&shell, turned, 2.0);
        assert_eq!(poses.n_near(), 2);
        poses.look_around(&shell, at(1.0), 2.0);
        assert_eq!(poses.n_near(), 0);
        poses.set_culling(false);
        poses.look_around(&shell, at(1.0), 2.0);
        assert_eq!(poses.n_near(), 2);
        let mut without_boxes = ObstaclePoses::new(&plates, [None, None].into_iter());
        without_boxes.look_around(&shell, at(1.0), 2.0);
        assert_eq!(without_boxes.n_near(), 2);
    }

    #[test]
    fn the_gap_of_a_sphere_is_that_to_the_nearest_place_of_the_box() {
        let plate = plate();
        let pose = ObstaclePose {
            world_from_map: Pose::from_translation(DVec3::Y * 5.0),
            center_map: DVec3::X * 10.0,
            half_m: DVec3::new(2.0, 1.0, 3.0),
            ..ObstaclePose::new(&plate, None)
        };
        assert_eq!(pose.center_world(), DVec3::new(10.0, 5.0, 0.0));
        // Past an edge by 3 m along x and 4 m along y: √(3² + 4²) less the radius.
        assert_eq!(pose.gap_m(pose.center_world() + DVec3::new(5.0, -5.0, 2.0), 1.0), 4.0);
        assert_eq!(pose.gap_m(pose.center_world(), 1.0), -1.0);
    }

    #[test]
    fn the_material_of_an_obstacle_goes_by_its_step_and_by_its_turn_about_the_center() {
        let step = PoseStep {
            center: DVec3::new(2.0, 1.0, 0.0),
            linear: DVec3::new(1.0, 2.0, 3.0),
            angular: DVec3::Z * 2.0,
        };
        // (1, 2, 3) + (0, 0, 2) × (3, 0, 0).
        assert_eq!(step.at(DVec3::new(5.0, 1.0, 0.0)), DVec3::new(1.0, 8.0, 3.0));
        assert!(!step.is_none());
        assert!(!PoseStep { linear: DVec3::ZERO, ..step }.is_none());
        assert!(!PoseStep { angular: DVec3::ZERO, ..step }.is_none());
        assert!(PoseStep { linear: DVec3::ZERO, angular: DVec3::ZERO, ..step }.is_none());
    }

    #[test]
    fn a_tool_may_go_as_far_as_is_clear_less_what_the_obstacle_may_go() {
        for (max_value_m, reserve_m, expected_m) in [
            // Of 10 mm two voxels of a millimetre may be overstated, and 3 mm are the obstacle's.
            (-10e-3, 3e-3, 5e-3),
            // At most half of what is left.
            (-10e-3, 6e-3, 4e-3),
            // In contact, half a voxel.
            (1e-3, 3e-3, 0.5e-3),
        ] {
            let limit_m = step_limit_m(max_value_m, 1e-3, 2.0, reserve_m);
            assert!((limit_m - expected_m).abs() < 1e-12, "{limit_m} and not {expected_m}");
        }
    }
}
