//! Contact: which points of the shell are inside which obstacle, and what wrench and stiffness that makes.
//!
//! # Units and frames
//! Sums are formed in tool axes about the centre of mass, where normals and arms are constants of the shell, and turned to world
//! axes once. `f32` per point and over a few blocks, `f64` beyond; always added in the order of the blocks: the same bits on every
//! machine.
//!
//! ```text
//!   flat (specification) ─┐
//!   traversal ─┬─ all ────┼─► Touched: blocks of the shell and depths ─► sum by face ─► normalisation ─► wrench, patches
//!              └─ walk ───┘
//! ```
//!
//! # Source
//! Sagardia2008, section 2 (traverse all points, sum penetration × normal); McNeely1999 (wrench about the centre of mass).

mod budget;
pub mod faces;
mod flat;
pub(in crate::haptics) mod places;
pub mod planes;
mod proximity;
mod simd;
mod sum;
mod touched;
mod traversal;
mod walk;

use glam::DVec3;

pub use budget::Budget;
pub use faces::FACES;
pub use flat::visit;
pub use proximity::Proximity;
pub use simd::Machine;
pub use touched::{Contact, Touched};
pub use traversal::{Traversal, Way};

use self::faces::face_of;
use self::places::FarSum;
use self::sum::{Sums, Total, Weighting};
use super::params::{ContactParameters, FilterParameters, Normalization};
use crate::pointshell::shell::Shell;
use crate::spatial::{Mat6, Pose, Twist, Wrench};
use crate::voxmap::field::{Field, FieldKind};

/// A static object as the tick sees it.
#[derive(Debug)]
pub struct Obstacle {
    /// Its field, map frame.
    pub field: Field,
    /// Where it stands until it is asked to go elsewhere.
    pub world_from_map: Pose,
}

impl Obstacle {
    /// Unit direction in world axes in which a contact leaves this obstacle fastest, −grad V; the contact's own normal where the gradient
    /// vanishes. The poses are those at which the contact was found. RT: safe, O(1).
    pub fn way_out_world(&self, world_from_map: Pose, world_from_body: Pose, contact: &Contact) -> DVec3 {
        let point_map = world_from_map.inverse().transform_point(world_from_body.transform_point(contact.arm_body.as_dvec3()));
        let cells = (point_map - self.field.origin_map().as_dvec3()) / f64::from(self.field.voxel_size_m());
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
    /// Force that presses it, normalisation included, N.
    pub force_n: f64,
    /// Unit direction that pushes the tool out, world axes.
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
    /// Points with V > 0.
    pub contacts: u32,
    /// Largest V over all points and obstacles, m; −band when everything is far. See [`Self::of`] for what a walk gives.
    pub max_value_m: f64,
    /// Contact wrench on the tool: stiffness times depths, stage S and normalisation applied where they are on.
    pub wrench: Wrench,
    /// Symmetric positive semi-definite contact stiffness −dW/dx, N/m, N, N·m/rad.
    pub stiffness: Mat6,
    /// Depth-weighted mean contact point relative to the centre of mass, m.
    pub arm_world: DVec3,
    /// Smallest voxel edge among the obstacles that are touched, m; of all obstacles when none is.
    pub voxel_size_m: f64,
    /// Largest displacement that a point may make in one tick without passing unnoticed through any
    /// obstacle: the proven clearance, or half a voxel near contact, m.
    pub step_limit_m: f64,
    /// Points and spheres that a walk looked at; 0 of the flat traversal, which looks at all points.
    pub looked_at: u32,
    /// Points that a budget left out: others stood for them.
    pub left_out: u32,
    /// How what touches moved in this tick, weighted by depth.
    pub carried: Carried,
    patches: [Option<Patch>; FACES],
    /// The same face by face; `None` while nothing that touches moves.
    carried_faces: Option<[Carried; FACES]>,
}

/// A small motion in one tick of what the tool touches: its material at the tool's centre of mass goes by `linear` (m), and turns by
/// `angular` (rad); world axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Carried {
    /// m.
    pub linear: DVec3,
    /// rad.
    pub angular: DVec3,
}

impl Carried {
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
pub type Also<'a> = dyn FnMut(usize, &Contact) + 'a;

impl ContactSum {
    /// What touches, face by face.
    pub fn patches(&self) -> impl Iterator<Item = &Patch> {
        self.patches.iter().flatten()
    }

    /// How each face is carried by what it touches.
    pub fn carried_faces(&self) -> Option<&[Carried; FACES]> {
        self.carried_faces.as_ref()
    }

    /// Traverses the whole shell against every obstacle, each where it stood at the start.
    ///
    /// `world_from_body`: tool axes at the centre of mass. Contact stiffness is the Gauss-Newton form K Σ w wᵀ with
    /// w = (n, r × n): the depth's gradient is taken as −n, which keeps the matrix positive semi-definite, so the implicit step
    /// can never gain energy from it. The exact Jacobian K n gᵀ differs where the shell's normal and the field's gradient do.
    ///
    /// RT: safe; O(obstacles · points).
    pub fn flat(
        obstacles: &[Obstacle],
        shell: &Shell,
        world_from_body: Pose,
        contact: &ContactParameters,
        filter: &FilterParameters,
    ) -> Self {
        let mut summing = Summing::new(contact, filter, world_from_body);
        for obstacle in obstacles {
            let map_from_body = obstacle.world_from_map.inverse() * world_from_body;
            let by = summing.weighting(obstacle);
            let mut n_contacts = 0;
            let max_value_m = flat::blocks(&obstacle.field, contact.field, shell, map_from_body, |touched| {
                n_contacts += touched.lanes.count_ones();
                let face = shell.normals().get(touched.block as usize).map_or(0, face_of);
                if let (Some(pushes), Some(sums)) = (touched.pushes(&obstacle.field, shell, map_from_body), summing.face(face)) {
                    Machine::Portable.add(sums, touched, &pushes, by);
                }
            });
            summing.note(obstacle, n_contacts, max_value_m, 0.0);
        }
        summing.finish()
    }

    /// The same by a prepared [`Traversal`], which remembers what cannot touch from one call to the next.
    ///
    /// While something touches, and the budget suffices, every bit is that of [`Self::flat`]. While nothing touches, −`max_value_m` of a
    /// walk is the clearance that it has proven, which is less. `obstacles` and `shell` must be those that the traversal was made for.
    /// `also` gets every contact with the number of its obstacle.
    ///
    /// RT: safe; allocates nothing.
    pub fn of(
        traversal: &mut Traversal,
        obstacles: &[Obstacle],
        shell: &Shell,
        world_from_body: Pose,
        contact: &ContactParameters,
        filter: &FilterParameters,
        mut also: Option<&mut Also<'_>>,
    ) -> Self {
        let machine = traversal.machine();
        let mut summing = Summing::new(contact, filter, world_from_body);
        summing.note_far(traversal.begin(shell, world_from_body, summing.overstated_voxels()));
        for n in 0..traversal.n_near() {
            let Some(obstacle_idx) = traversal.places().near(n) else { break };
            let (Some(obstacle), Some(stand)) = (obstacles.get(obstacle_idx), traversal.places().stand(obstacle_idx)) else {
                break;
            };
            let map_from_body = stand.world_from_map.inverse() * world_from_body;
            let reserve_m = stand.reserve_m;
            let center = world_from_body.translation;
            let carried =
                (!stand.moved.is_none()).then(|| Carried { linear: stand.moved.at(center), angular: stand.moved.angular });
            let by = summing.weighting(obstacle);
            let found = traversal.find((n, obstacle_idx), obstacle, contact.field, shell, map_from_body);
            let mut n_contacts = 0;
            // Blocks of one face come mostly one after the other.
            let kind = |touched: &Touched| (traversal.face(touched.block), touched.bends(&obstacle.field, shell));
            for run in traversal.touched().chunk_by(|one, other| kind(one) == kind(other)) {
                let Some((face, bends)) = run.first().map(kind) else { continue };
                if let Some(carried) = carried {
                    summing.carry(face, carried, run);
                }
                let Some(sums) = summing.face(face) else { continue };
                n_contacts += run.iter().map(|touched| touched.lanes.count_ones()).sum::<u32>();
                if bends {
                    for touched in run {
                        if let Some(pushes) = touched.pushes(&obstacle.field, shell, map_from_body) {
                            machine.add(sums, touched, &pushes, by);
                        }
                    }
                } else {
                    machine.add_all(sums, run, (shell.positions(), shell.normals()), by);
                }
            }
            if let Some(also) = also.as_mut() {
                for touched in traversal.touched() {
                    touched.contacts(&obstacle.field, shell, map_from_body, |contact| also(obstacle_idx, contact));
                }
            }
            summing.note(obstacle, n_contacts, found.max_value_m, reserve_m);
            if reserve_m > 0.0 {
                traversal.note_pressed((obstacle_idx, obstacle), shell, (world_from_body, map_from_body), found.max_value_m);
            }
            summing.left_out += found.left_out;
            summing.looked_at += found.looked_at;
        }
        summing.finish()
    }
}

/// Contacts from which an averaged sum stops growing (McNeely1999: F_tot below ten contacts, F_tot/(N/10) from ten on).
pub const AVERAGED_CONTACTS: f64 = 10.0;

/// The sums while obstacles are added.
struct Summing<'a> {
    contact: &'a ContactParameters,
    filter: &'a FilterParameters,
    world_from_body: Pose,
    /// Tool axes; of all obstacles together. `None` until a face touches: they are large, and most never do.
    faces: [Option<Sums>; FACES],
    contacts: u32,
    max_value_m: f64,
    voxel_size_m: f64,
    touched_voxel_m: f64,
    step_limit_m: f64,
    looked_at: u32,
    left_out: u32,
    /// Σ depth · motion of what is touched by each face.
    carried: Option<[Carried; FACES]>,
}

impl<'a> Summing<'a> {
    fn new(contact: &'a ContactParameters, filter: &'a FilterParameters, world_from_body: Pose) -> Self {
        Self {
            contact,
            filter,
            world_from_body,
            faces: [const { None }; FACES],
            contacts: 0,
            max_value_m: f64::NEG_INFINITY,
            voxel_size_m: f64::INFINITY,
            touched_voxel_m: f64::INFINITY,
            step_limit_m: f64::INFINITY,
            looked_at: 0,
            left_out: 0,
            carried: None,
        }
    }

    /// Notes that what these blocks of a face touch has moved.
    fn carry(&mut self, face: u8, carried: Carried, run: &[Touched]) {
        let depth_m =
            |touched: &Touched| touched.lanes().filter_map(|lane| touched.depths_m.get(lane)).sum::<f32>() * touched.weight;
        let depth_m = run.iter().map(|touched| f64::from(depth_m(touched))).sum();
        let faces = self.carried.get_or_insert_with(|| [Carried::default(); FACES]);
        if let Some(sum) = faces.get_mut(usize::from(face)) {
            sum.add(depth_m, carried);
        }
    }

    fn weighting(&self, obstacle: &Obstacle) -> Weighting {
        Weighting::new(obstacle.field.voxel_size_m(), self.filter.spatial)
    }

    /// The sums of a face that touches.
    #[inline]
    fn face(&mut self, face: u8) -> Option<&mut Sums> {
        self.faces.get_mut(usize::from(face)).map(|sums| sums.get_or_insert_with(|| Sums::ZERO))
    }

    /// By how much a clearance may be overstated: interpolation by half the diagonal of a cell, the other look-ups by up to two voxels.
    fn overstated_voxels(&self) -> f64 {
        if self.contact.field == FieldKind::Trilinear { 0.5 * 3_f64.sqrt() } else { 2.0 }
    }

    /// Notes the obstacles that need not be asked.
    fn note_far(&mut self, far: FarSum) {
        self.max_value_m = self.max_value_m.max(far.max_value_m);
        self.voxel_size_m = self.voxel_size_m.min(far.voxel_size_m);
        self.step_limit_m = self.step_limit_m.min(far.step_limit_m);
    }

    /// Notes what else was found at an obstacle.
    fn note(&mut self, obstacle: &Obstacle, n_contacts: u32, max_value_m: f32, reserve_m: f64) {
        let max_value_m = f64::from(max_value_m);
        let voxel_size_m = f64::from(obstacle.field.voxel_size_m());
        self.contacts += n_contacts;
        self.max_value_m = self.max_value_m.max(max_value_m);
        self.voxel_size_m = self.voxel_size_m.min(voxel_size_m);
        let limit_m = places::step_limit_m(max_value_m, voxel_size_m, self.overstated_voxels(), reserve_m);
        self.step_limit_m = self.step_limit_m.min(limit_m);
        if n_contacts > 0 {
            self.touched_voxel_m = self.touched_voxel_m.min(voxel_size_m);
        }
    }

    fn finish(&self) -> ContactSum {
        let rotation = self.world_from_body.rotation_matrix();
        let stiffness_n_per_m = self.contact.stiffness_n_per_m;
        // Turned zeros may get a sign; free space is exactly zero.
        let rotation = if self.contacts > 0 { rotation } else { glam::DMat3::IDENTITY };
        let mut totals = [None; FACES];
        let mut effective = 0.0;
        for (total, sums) in totals.iter_mut().zip(&self.faces) {
            if let Some(sums) = sums {
                effective += total.insert(sums.total()).effective;
            }
        }
        let mut sum = ContactSum {
            contacts: self.contacts,
            max_value_m: self.max_value_m,
            wrench: Wrench::ZERO,
            stiffness: Mat6::ZERO,
            arm_world: DVec3::ZERO,
            voxel_size_m: if self.contacts > 0 { self.touched_voxel_m } else { self.voxel_size_m },
            step_limit_m: self.step_limit_m,
            looked_at: self.looked_at,
            left_out: self.left_out,
            carried: Carried::default(),
            patches: [None; FACES],
            carried_faces: self.carried,
        };
        let (mut depth, mut depth_arm) = (0.0, DVec3::ZERO);
        let (mut force, mut moment, mut stiffness) = (DVec3::ZERO, DVec3::ZERO, Mat6::ZERO);
        for ((face, total), patch) in totals.iter().enumerate().zip(&mut sum.patches) {
            let Some(total) = total else { continue };
            let share = match self.contact.normalization {
                Normalization::None => 1.0,
                Normalization::Average => within_ten(effective),
                Normalization::Cluster => within_ten(total.effective),
            };
            force += total.depth_normal * share;
            moment += total.depth_moment * share;
            stiffness = stiffness.plus_scaled(share, &total.stiffness);
            depth += total.depth;
            depth_arm += total.depth_arm;
            *patch = Patch::of(face as u8, total, share * stiffness_n_per_m, rotation);
        }
        sum.wrench = Wrench::new(rotation * force, rotation * moment) * stiffness_n_per_m;
        sum.stiffness = Mat6::ZERO.plus_scaled(stiffness_n_per_m, &stiffness.rotated(rotation));
        if depth > 0.0 {
            sum.arm_world = rotation * depth_arm / depth;
        }
        if let Some(faces) = sum.carried_faces.as_mut() {
            for (carried, total) in faces.iter_mut().zip(&totals) {
                sum.carried.add(1.0 / depth, *carried);
                *carried = total.map_or(Carried::default(), |total| carried.scaled(1.0 / total.depth));
            }
        }
        sum
    }
}

/// The factor that keeps a sum of so many contacts at what ten of them give.
fn within_ten(effective: f64) -> f64 {
    1.0 / (effective / AVERAGED_CONTACTS).max(1.0)
}

impl Patch {
    /// From the sums of a face; `None` where it presses nothing.
    fn of(face: u8, total: &Total, stiffness_n_per_m: f64, rotation: glam::DMat3) -> Option<Self> {
        let normal = total.depth_normal.try_normalize()?;
        let arm = total.depth_arm / total.depth;
        let (along, about) = total.stiffness.traces();
        let squared = if along > 0.0 { about / along - arm.cross(normal).length_squared() } else { 0.0 };
        arm.is_finite().then(|| Self {
            face,
            force_n: stiffness_n_per_m * total.depth_normal.length(),
            normal_world: rotation * normal,
            arm_world: rotation * arm,
            radius_m: squared.max(0.0).sqrt(),
            stiffness_n_per_m: stiffness_n_per_m * total.stiffness.mul(normal, DVec3::ZERO).0.dot(normal),
        })
    }
}
