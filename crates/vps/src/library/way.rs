//! One way of a query: the points of one part in the voxmaps of others.

use glam::{DMat3, DVec3, Vec3};

use super::query::{ContactPoint, ContactWrench, NearestPoint};
use super::{PointShell, Voxmap};
use crate::contact::{
    Also, Contact, ContactSum, ForceLaw, Highest, Obstacle, SimdLevel, Traversal, TraversalMode,
};
use crate::pointshell::shell::LANES;
use crate::spatial::{Mat6, Pose, Wrench};

/// Points of one part in the voxmaps of others. A pose is that of the part that moves in the world.
#[derive(Debug)]
pub(super) struct Way {
    pub(super) parts: Vec<Obstacle>,
    pub(super) shell: PointShell,
    pub(super) law: ForceLaw,
    /// The voxmap is that of the part that moves, and the points are those of the part that stands
    /// still, in its mesh frame, which is then the world.
    pub(super) is_back: bool,
    /// Number of the first voxmap among those of the query.
    pub(super) first_part: u32,
    /// As [`ContactQuery::error_m`](super::ContactQuery::error_m), m.
    pub(super) error_m: Option<f64>,
}

/// By how much facets are off beside what the voxmap adds, in voxel edges of the shell: a bound
/// that was found by experiment, and holds with half of it for most parts.
const FACET_ERROR_VOXELS: f64 = 0.1;

/// What a shell may be off by in some voxmaps, m.
pub(super) fn error_m<'a>(
    voxmaps: impl IntoIterator<Item = &'a Voxmap>,
    shell: &PointShell,
) -> Option<f64> {
    let is_of_facets = !shell.shell().is_skin() && !shell.shell().half_axes().is_empty();
    let of_shell_m = shell.accuracy().unseen_depth_m.filter(|_| is_of_facets)?;
    let of_facets_m = FACET_ERROR_VOXELS * shell.voxel_size_m();
    let mut most_m = 0.0_f64;
    for voxmap in voxmaps {
        let of_field_m = voxmap.accuracy().surface_error_m.filter(|_| !voxmap.field().is_thin())?;
        most_m = most_m.max(of_field_m);
    }
    Some(most_m + of_shell_m + of_facets_m)
}

impl Way {
    pub(super) fn traversal(&self) -> Traversal {
        Traversal::new(SimdLevel::best(), TraversalMode::Tree, &self.parts, self.shell.shell())
    }

    /// From body axes of the shell to the frame in which the voxmaps stand.
    fn maps_from_body(&self, pose: Pose) -> Pose {
        let maps_from_shell = if self.is_back { pose.inverse() } else { pose };
        maps_from_shell * self.shell_from_body()
    }

    fn world_from_body(&self, pose: Pose) -> Pose {
        if self.is_back { self.shell_from_body() } else { pose * self.shell_from_body() }
    }

    fn shell_from_body(&self) -> Pose {
        Pose::from_translation(self.shell.mass_properties().center_m)
    }

    /// What a force on the shell counts as one on the part that moves.
    fn sign(&self) -> f64 {
        if self.is_back { -1.0 } else { 1.0 }
    }

    fn plain_sum(&self, traversal: &mut Traversal, pose: Pose) -> ContactSum {
        let Self { parts, shell, law, .. } = self;
        ContactSum::of(traversal, parts, shell.shell(), self.maps_from_body(pose), *law, None)
    }

    /// Wrench on the shell about its centre of mass, world axes.
    fn on_shell(&self, sum: &ContactSum, pose: Pose) -> Wrench {
        if !self.is_back {
            return sum.wrench;
        }
        let [force, torque] =
            [sum.wrench.force, sum.wrench.torque].map(|vector| pose.transform_vector(vector));
        Wrench::new(force, torque)
    }

    pub(super) fn felt(
        &self,
        traversal: &mut Traversal,
        pose: Pose,
        also: Option<&mut Also<'_>>,
    ) -> ContactWrench {
        let Self { parts, shell, law, .. } = self;
        let body = self.maps_from_body(pose);
        let sum = ContactSum::with_clearance(traversal, parts, shell.shell(), body, *law, also);
        let bands_m = parts.iter().map(|part| part.field.known_outside_m());
        let band_m = bands_m.fold(f32::INFINITY, f32::min).into();
        let center = self.world_from_body(pose).translation;
        ContactWrench {
            wrench: self.on_shell(&sum, pose).moved(center, pose.translation) * self.sign(),
            contacts: sum.contacts,
            penetration_m: sum.max_value_m.max(0.0),
            clearance_m: if sum.contacts > 0 { 0.0 } else { (-sum.max_value_m).clamp(0.0, band_m) },
        }
    }

    pub(super) fn contacts(
        &self,
        traversal: &mut Traversal,
        pose: Pose,
        mut each: impl FnMut(&ContactPoint),
    ) -> ContactWrench {
        let world_from_body = self.world_from_body(pose);
        let voxel_area_m2 = self.shell.voxel_size_m().powi(2);
        let mut also = |part: usize, contact: &Contact| {
            let outward = |body: Vec3| world_from_body.transform_vector(body.into()) * self.sign();
            let normal = outward(contact.normal_body);
            each(&ContactPoint {
                part: self.first_part + part as u32,
                point: contact.point_idx,
                position_m: world_from_body.transform_point(contact.pressed_body.as_dvec3()),
                normal,
                gradient: outward(contact.way_out_body),
                depth_m: contact.noted_depth_m().into(),
                area_m2: f64::from(contact.weight) * voxel_area_m2,
                force_n: normal
                    * (self.law.stiffness_n_per_m
                        * f64::from(contact.mean_depth_m)
                        * f64::from(contact.weight)),
            });
        };
        self.felt(traversal, pose, Some(&mut also))
    }

    /// Second derivative of the energy by motions of the part that moves, about the origin of its
    /// mesh frame.
    pub(super) fn stiffness(&self, traversal: &mut Traversal, pose: Pose) -> Mat6 {
        let sum = self.plain_sum(traversal, pose);
        let center = self.world_from_body(pose).translation;
        let on_shell = self.on_shell(&sum, pose);
        if !self.is_back {
            return sum.stiffness.moved(on_shell, center, pose.translation);
        }
        let by_shell = sum.stiffness.rotated(pose.rotation_matrix());
        let by_shell = by_shell.moved(on_shell, center, pose.translation);
        // A motion (u, θ) of the one part is (−u + θ × u, −θ) of the other one, to second order:
        // beside the same second derivative there is −force · (θ × u) = θ · (force × u).
        let [x, y, z] = DVec3::AXES.map(|axis| on_shell.force.cross(axis));
        let cross = DMat3::from_cols(x, y, z);
        by_shell.plus_scaled(
            1.0,
            &Mat6::from_blocks(DMat3::ZERO, cross.transpose(), cross, DMat3::ZERO),
        )
    }

    /// The highest point while nothing touches.
    pub(super) fn highest(&self, traversal: &mut Traversal, pose: Pose) -> Option<Highest> {
        let Self { parts, shell, law, .. } = self;
        let sum = self.plain_sum(traversal, pose);
        let body = self.maps_from_body(pose);
        (sum.contacts == 0).then(|| Highest::of(traversal, parts, shell.shell(), body, *law))
    }

    /// The place on a part that is nearest to the highest point.
    pub(super) fn nearest(&self, highest: Highest, pose: Pose) -> Option<NearestPoint> {
        let part = highest.obstacle_idx?;
        let Obstacle { field, world_from_map } = self.parts.get(part)?;
        let distance_m = -highest.value_m;
        let voxel_size_m = f64::from(field.voxel_size_m());
        // Directions take distances half a cell farther out.
        if distance_m > f64::from(field.known_outside_m()) - voxel_size_m {
            return None;
        }
        let shell = self.shell.shell();
        let map_from_body = world_from_map.inverse() * self.maps_from_body(pose);
        let point = highest.point(field, shell, map_from_body)?;
        let block = shell.positions().get(point as usize / LANES)?;
        let arm = block.get(point as usize % LANES).as_dvec3();
        let mut on_map = map_from_body.transform_point(arm);
        // Once the whole way, and what is off there. Within a cell interpolated gradients are off
        // by up to half a cell over the distance; differences over a cell are not.
        for _ in 0..3 {
            let cells = ((on_map - field.origin_map().as_dvec3()) / voxel_size_m).as_vec3();
            let depth_m = |cells: Vec3| field.distance(cells).0;
            let grows = |axis: Vec3| depth_m(cells + 0.5 * axis) - depth_m(cells - 0.5 * axis);
            let inward = Vec3::from_array(Vec3::AXES.map(grows)).as_dvec3();
            on_map -= inward.normalize_or_zero() * f64::from(depth_m(cells));
        }
        let of_point = self.world_from_body(pose).transform_point(arm);
        let on_map = world_from_map.transform_point(on_map);
        let of_map = if self.is_back { pose.transform_point(on_map) } else { on_map };
        let [on_shell_m, on_part_m] =
            if self.is_back { [of_map, of_point] } else { [of_point, of_map] };
        Some(NearestPoint {
            part: self.first_part + part as u32,
            point,
            on_shell_m,
            on_part_m,
            distance_m,
        })
    }

    /// How far any point may go before something touches, m; `None`: something does.
    pub(super) fn free_way_m(&self, traversal: &mut Traversal, pose: Pose) -> Option<f64> {
        let sum = self.plain_sum(traversal, pose);
        (sum.contacts == 0).then_some(sum.free_way_m)
    }

    /// No point goes farther than this against the voxmaps while a centre `turned` about goes from
    /// one place to another, both evenly, and the part turns about it by an angle, rad; m.
    pub(super) fn farthest_m(&self, [from, to]: [DVec3; 2], turn: f64) -> f64 {
        let shell = self.shell.shell();
        let own = self.shell.mass_properties().center_m;
        // From the centre of the turn to that of the points: the greatest is at an end.
        let apart_m = if self.is_back { own.distance(from).max(own.distance(to)) } else { 0.0 };
        from.distance(to) + turn * (apart_m + shell.radius_m() + f64::from(shell.reach_m()))
    }
}
