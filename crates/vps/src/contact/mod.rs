//! Contact: which points of the shell are inside which obstacle, and what wrench and stiffness that
//! makes.
//!
//! # Units and frames
//! Sums are formed in tool axes about the centre of mass, where normals and arms are constants of
//! the shell, and turned to world axes once. `f32` per point and over a few blocks, `f64` beyond;
//! always added in the order of the blocks: the same bits on every machine.
//!
//! ```text
//!   flat (specification) ─┐
//!   traversal ─┬─ all ────┼─► ContactBlock: blocks of the shell and depths ─► sum by face ─► normalisation ─► wrench, patches
//!              └─ walk ───┘
//! ```
//!
//! # Source
//! Sagardia2008, section 2 (traverse all points, sum penetration × normal); McNeely1999 (wrench
//! about the centre of mass).

mod budget;
mod clay;
mod clip;
mod contact_block;
#[doc(hidden)]
pub mod faces;
mod flat;
mod highest;
mod immersion;
mod kernel;
#[doc(hidden)]
pub mod obstacle_poses;
#[doc(hidden)]
pub mod planes;
mod proximity;
mod samples;
mod sum;
mod summing;
#[cfg(test)]
mod tests;
mod traversal;
mod tree_traversal;

use glam::DVec3;

pub use crate::simd::SimdLevel;
pub use budget::Budget;
pub use contact_block::{Contact, ContactBlock};
pub use faces::FACES;
pub use flat::visit;
pub(crate) use highest::Highest;
pub use proximity::Proximity;
pub use summing::{AVERAGED_CONTACTS, FaceSums};
pub use traversal::{Traversal, TraversalMode};

use self::clip::CreasesAt;
use self::faces::BlockFaces;
use self::immersion::slack_m;
use self::kernel::Place;
use self::sum::AddAll;
use self::summing::Summing;
use self::tree_traversal::QueryResult;
use crate::pointshell::shell::Shell;
use crate::spatial::{Mat6, Pose, Twist, Wrench};
use crate::voxmap::field::{Field, FieldKind};

/// What normalisation does with the sum over points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Normalization {
    /// The plain sum of the paper: stiffness grows with contact area.
    #[default]
    None,
    /// McNeely's averaging without its steps: F / max(1, N_eff/10).
    Average,
}

/// How depths become forces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ForceLaw {
    /// Field look-up that gives the depth of a point.
    pub field: FieldKind,
    /// Penalty stiffness of one point, N/m.
    pub stiffness_n_per_m: f64,
    /// What many points that touch are worth together.
    pub normalization: Normalization,
}

impl ForceLaw {
    /// Interpolated depths, 1 N/mm for each point, nothing else.
    pub const PLAIN: Self = Self {
        field: FieldKind::Trilinear,
        stiffness_n_per_m: 1000.0,
        normalization: Normalization::None,
    };
}

/// A static object as a query sees it.
#[derive(Debug)]
pub struct Obstacle {
    /// Its depths, map frame.
    pub field: Field,
    /// Where it stands until it is asked to go elsewhere.
    pub world_from_map: Pose,
}

impl Obstacle {
    /// Unit direction in world axes in which a contact leaves this obstacle fastest, −grad V; the
    /// contact's own normal where the gradient vanishes. The poses are those at which the contact
    /// was found. RT: safe, O(1).
    pub fn way_out_world(
        &self,
        world_from_map: Pose,
        world_from_body: Pose,
        contact: &Contact,
    ) -> DVec3 {
        let point_map = world_from_map
            .inverse()
            .transform_point(world_from_body.transform_point(contact.arm_body.as_dvec3()));
        let cells =
            (point_map - self.field.origin_map().as_dvec3()) / f64::from(self.field.voxel_size_m());
        match (-self.field.gradient(cells.as_vec3())).as_dvec3().try_normalize() {
            Some(normal_map) => world_from_map.transform_vector(normal_map),
            None => world_from_body.transform_vector(contact.normal_body.as_dvec3()),
        }
    }
}

/// What touches with one face of the tool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch {
    /// Number of the face.
    pub face: u8,
    /// Force along the normal that presses it, normalisation included, N.
    pub force_n: f64,
    /// Unit normal of what it touches, out of that, world axes: the depth's gradient.
    pub normal_world: DVec3,
    /// Depth-weighted middle, relative to the centre of mass, world axes, m.
    pub arm_world: DVec3,
    /// Radius of gyration about the normal through the middle, m.
    pub radius_m: f64,
    /// Stiffness along the normal, N/m.
    pub stiffness_n_per_m: f64,
}

/// The sum over all contacts of all obstacles, world axes, about the tool's centre of mass.
#[derive(Clone, Copy, Debug)]
pub struct ContactSum {
    /// Facets that are immersed, be it in part, and points with V > 0.
    pub contacts: u32,
    /// Largest V over all points and obstacles, m, and largest mean depth of a facet that is
    /// immersed; −band when everything is far. See [`Self::of`] for what a walk gives.
    pub max_value_m: f64,
    /// Some point is as deep as the field of an obstacle knows depths: it may be deeper.
    pub depth_is_bound: bool,
    /// Contact wrench on the tool: stiffness times mean depths, normalised where that is on.
    pub wrench: Wrench,
    /// Symmetric contact stiffness −dW/dx without the terms that the wrench itself makes, N/m, N,
    /// N·m/rad. Not always positive: see [`Self::flat`].
    pub stiffness: Mat6,
    /// Depth-weighted mean contact point relative to the centre of mass, m.
    pub arm_world: DVec3,
    /// Smallest voxel edge among the obstacles that are touched, m; of all obstacles when none is.
    pub voxel_size_m: f64,
    /// Largest displacement that a point may make in one tick without passing unnoticed through any
    /// obstacle: the proven clearance, or half a voxel near contact, m.
    pub step_limit_m: f64,
    /// Points and spheres that a walk looked at; 0 of the flat traversal, which looks at all
    /// points.
    pub looked_at: u32,
    /// Points that a budget left out: others stood for them.
    pub left_out: u32,
    /// How what touches moved in this tick, weighted by depth.
    pub obstacle_motion: ObstacleMotion,
    /// How far the tool may move in any way before anything touches, m; 0 while something touches.
    pub free_way_m: f64,
    /// Nothing touches, and `max_value_m` may be more than the largest V.
    clearance_is_bound: bool,
    /// A rope pulls as well.
    is_roped: bool,
    patches: [Option<Patch>; FACES],
    /// The same face by face; `None` while nothing that touches moves.
    carried_faces: Option<[ObstacleMotion; FACES]>,
}

/// A small motion in one tick of what the tool touches: its material at the tool's centre of mass
/// goes by `linear` (m), and turns by `angular` (rad); world axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ObstacleMotion {
    /// m.
    pub linear: DVec3,
    /// rad.
    pub angular: DVec3,
}

impl ObstacleMotion {
    fn add(&mut self, weight: f64, other: Self) {
        self.linear += other.linear * weight;
        self.angular += other.angular * weight;
    }

    fn scaled(self, share: f64) -> Self {
        Self { linear: self.linear * share, angular: self.angular * share }
    }

    /// The velocity of what goes so far in a tick.
    pub fn over(self, period_s: f64) -> Twist {
        Twist { linear: self.linear / period_s, angular: self.angular / period_s }
    }
}

/// Gets every contact with the number of its obstacle.
pub(crate) type Also<'a> = dyn FnMut(usize, &Contact) + 'a;

impl ContactSum {
    /// What touches, face by face.
    pub fn patches(&self) -> impl Iterator<Item = &Patch> + Clone {
        self.patches.iter().flatten()
    }

    /// True when the wrench is that of something: a contact or a rope.
    pub fn acts(&self) -> bool {
        self.contacts > 0 || self.is_roped
    }

    /// How each face is carried by what it touches.
    pub fn carried_faces(&self) -> Option<&[ObstacleMotion; FACES]> {
        self.carried_faces.as_ref()
    }

    /// Traverses the whole shell against every obstacle, each where it stood at the start.
    ///
    /// `world_from_body`: tool axes at the centre of mass. With K the stiffness of a point, n its
    /// normal, r its arm and g the gradient of its depth, the wrench changes with the pose by
    /// G = K Σ J Dᵀ, J = (n, r × n), D = (g, r × g), and by terms with the force itself. The
    /// stiffness is −G as the second derivative of an energy, which is symmetric: the symmetric
    /// parts of the blocks of translations and of turns, and between both the block of moments by
    /// translations. Of a facet that is immersed in part that part counts. The sum over a cone on a
    /// plane has none along the plane, though each of its points has. On bent surfaces it may have
    /// negative eigenvalues.
    ///
    /// Allocates; O(obstacles · points).
    pub fn flat(
        obstacles: &[Obstacle],
        shell: &Shell,
        world_from_body: Pose,
        law: ForceLaw,
    ) -> Self {
        let mut sums = FaceSums::new();
        let mut summing = Summing::new(law, world_from_body, &mut sums);
        for obstacle in obstacles {
            let map_from_body = obstacle.world_from_map.inverse() * world_from_body;
            let by = summing.weighting(obstacle, shell);
            let place = Place::new(&obstacle.field, map_from_body);
            let at = CreasesAt::new(&obstacle.field, &place);
            let mut n_contacts = 0;
            let max_value_m =
                flat::blocks(&obstacle.field, law.field, shell, map_from_body, |touched| {
                    n_contacts += touched.lanes.count_ones();
                    let normals = shell.normals().get(touched.block as usize);
                    let faces = normals.map(|normals| BlockFaces::of(shell, normals));
                    for (face, touched) in faces.iter().flat_map(|faces| faces.split(touched)) {
                        let Some(sums) = summing.face(face) else { continue };
                        let touched = core::slice::from_ref(&touched);
                        SimdLevel::Portable.run(AddAll { sums, touched, shell, by, at });
                    }
                });
            let reach_m = shell.reach_m() + slack_m(&obstacle.field, law.field);
            summing.note(obstacle, n_contacts, &QueryResult::of_all(max_value_m, reach_m), 0.0);
        }
        summing.finish()
    }

    /// The same by a prepared [`Traversal`], which remembers what cannot touch from one call to the
    /// next.
    ///
    /// While something touches, and the budget suffices, every bit is that of [`Self::flat`]. While
    /// nothing touches, −`max_value_m` of a walk is the clearance that it has proven, which is
    /// less. `obstacles` and `shell` must be those that the traversal was made for. `also` gets
    /// every contact with the number of its obstacle.
    ///
    /// RT: safe; allocates nothing.
    pub fn of(
        traversal: &mut Traversal,
        obstacles: &[Obstacle],
        shell: &Shell,
        world_from_body: Pose,
        law: ForceLaw,
        mut also: Option<&mut Also<'_>>,
    ) -> Self {
        let simd_level = traversal.simd_level();
        let mut sums = traversal.take_sums();
        let mut summing = Summing::new(law, world_from_body, &mut sums);
        summing.note_far(traversal.begin(shell, world_from_body, summing.overstated_voxels()));
        for n in 0..traversal.n_near() {
            let Some(obstacle_idx) = traversal.obstacle_poses().near(n) else { break };
            let (Some(obstacle), Some(pose)) =
                (obstacles.get(obstacle_idx), traversal.obstacle_poses().pose(obstacle_idx))
            else {
                break;
            };
            let map_from_body = pose.world_from_map.inverse() * world_from_body;
            let reserve_m = pose.reserve_m;
            let center = world_from_body.translation;
            let carried = (!pose.moved.is_none()).then(|| ObstacleMotion {
                linear: pose.moved.at(center),
                angular: pose.moved.angular,
            });
            let by = summing.weighting(obstacle, shell);
            let place = Place::new(&obstacle.field, map_from_body);
            let at = CreasesAt::new(&obstacle.field, &place);
            let found =
                traversal.find((n, obstacle_idx), obstacle, law.field, shell, map_from_body);
            let mut n_contacts = 0;
            // Blocks of one face come mostly one after the other.
            let face_of = |touched: &ContactBlock| traversal.face(touched);
            let mut add = |face, touched: &[ContactBlock]| {
                let Some(sums) = summing.face(face) else { return };
                n_contacts += touched.iter().map(|touched| touched.lanes.count_ones()).sum::<u32>();
                simd_level.run(AddAll { sums, touched, shell, by, at });
                if let Some(carried) = carried {
                    let depth_m = touched.iter().map(|touched| touched.depth_m(shell, &at)).sum();
                    summing.carry(face, carried, depth_m);
                }
            };
            for run in traversal.touched().chunk_by(|one, other| face_of(one) == face_of(other)) {
                match run.first().map(face_of) {
                    Some(Some(face)) => add(face, run),
                    _ => run
                        .iter()
                        .flat_map(|touched| traversal.split(touched))
                        .for_each(|(face, touched)| add(face, core::slice::from_ref(&touched))),
                }
            }
            if let Some(also) = also.as_mut() {
                for touched in traversal.touched() {
                    touched.contacts(&obstacle.field, shell, map_from_body, |contact| {
                        also(obstacle_idx, contact);
                    });
                }
            }
            summing.note(obstacle, n_contacts, &found, reserve_m);
            if reserve_m > 0.0 {
                traversal.note_pressed(
                    (obstacle_idx, obstacle),
                    shell,
                    world_from_body,
                    found.max_value_m,
                );
            }
        }
        let sum = summing.finish();
        traversal.keep_sums(sums);
        sum
    }

    /// The same, and while nothing touches `max_value_m` is to the bit that of [`Self::flat`]: minus
    /// the distance of the nearest point. Costs up to about twice what contact costs. RT: safe.
    pub fn with_clearance(
        traversal: &mut Traversal,
        obstacles: &[Obstacle],
        shell: &Shell,
        world_from_body: Pose,
        law: ForceLaw,
        also: Option<&mut Also<'_>>,
    ) -> Self {
        let mut sum = Self::of(traversal, obstacles, shell, world_from_body, law, also);
        if !sum.clearance_is_bound {
            return sum;
        }
        sum.max_value_m = Highest::of(traversal, obstacles, shell, world_from_body, law).value_m;
        sum
    }
}
