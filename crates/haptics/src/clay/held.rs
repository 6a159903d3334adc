//! The clay that a tick holds: the newest frame and the one before, and what is remembered of
//! forces.

#![expect(
    clippy::disallowed_types,
    reason = "made and freed on the cold side, exchanged as pointers"
)]

use glam::DVec3;

use super::residual::Residual;
use super::{Clay, PUT_DOWN_SPACINGS};
use crate::Parameters;
use vps::contact::faces::BlockFaces;
use vps::contact::{ContactSum, FaceSums, SimdLevel};
use vps::density::{DensityFrame, Probe};
use vps::pointshell::shell::Shell;
use vps::spatial::{Pose, Wrench};

/// How long a leap of the surface takes to be felt to nine tenths, s: a hand has to be able to
/// follow.
const LEAP_S: f64 = 0.3;

/// What clay does to the tool in a tick, world axes, about its centre of mass.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ClayForces {
    /// Of the surface, as it is felt; friction apart.
    pub contact_world: Wrench,
    /// Of the rope, N.
    pub rope_world: DVec3,
    /// Points of the tool in the clay.
    pub contacts: u32,
}

/// Frames and memory.
#[derive(Clone, Debug)]
pub(crate) struct Held {
    newest: Box<DensityFrame>,
    before: Box<DensityFrame>,
    /// The newest frame has not been touched yet.
    is_new: bool,
    residual: Residual,
    /// Where the rope is felt to pull, map frame, m.
    anchor_map: Option<DVec3>,
    forces: ClayForces,
    simd_level: SimdLevel,
    /// Of the blocks of the shell.
    faces: Box<[BlockFaces]>,
    sums: FaceSums,
}

impl Held {
    /// The clay of a scene, as it is before the first update. Allocates; RT: start-up only.
    pub(crate) fn new(clay: &Clay, shell: &Shell) -> Self {
        let newest = Box::new(clay.frame.clone());
        Self {
            before: newest.clone(),
            newest,
            is_new: false,
            residual: Residual::default(),
            anchor_map: None,
            forces: ClayForces::default(),
            simd_level: SimdLevel::best(),
            faces: BlockFaces::all_of(shell),
            sums: FaceSums::new(),
        }
    }

    /// Takes a newer frame and gives one that is not needed any more. RT: safe; pointers.
    pub(crate) fn exchange(&mut self, mut frame: Box<DensityFrame>) -> Box<DensityFrame> {
        // A leap in a frame that no tick has touched is still to come.
        frame.is_leap |= self.is_new && self.newest.is_leap;
        let newest = core::mem::replace(&mut self.newest, frame);
        // One that no tick has touched is nothing to go on from.
        if core::mem::replace(&mut self.is_new, true) {
            newest
        } else {
            core::mem::replace(&mut self.before, newest)
        }
    }

    /// Number of the newest frame.
    pub(crate) fn sequence(&self) -> u64 {
        self.newest.sequence
    }

    /// What the last tick found.
    pub(crate) fn forces(&self) -> ClayForces {
        self.forces
    }

    /// Forgets all force.
    pub(crate) fn at_rest(&mut self) {
        (self.residual, self.anchor_map) = (Residual::default(), None);
    }

    /// The simulation does not move the anchor of the rope any more: the tool is let go, as at the
    /// end of a pull. RT: safe.
    pub(crate) fn let_go(&mut self) {
        (self.newest.rope_map, self.before.rope_map) = (None, None);
    }

    /// The tool at this pose would be in the clay, deeper than one that was put down on it. RT:
    /// safe; as much work as to touch it.
    pub(crate) fn is_inside(
        &mut self,
        clay: &Clay,
        shell: &Shell,
        world_from_body: Pose,
        p: &Parameters,
    ) -> bool {
        let sum = self.ask(true, (clay, shell), world_from_body, p);
        sum.contacts > 0 && sum.max_value_m > PUT_DOWN_SPACINGS * sum.voxel_size_m
    }

    /// What a frame, the newest or the one before, does to the tool at this pose.
    fn ask(
        &mut self,
        is_newest: bool,
        (clay, shell): (&Clay, &Shell),
        world_from_body: Pose,
        p: &Parameters,
    ) -> ContactSum {
        let frame = if is_newest { &self.newest } else { &self.before };
        let probe = Probe::new(frame, clay.world_from_map.inverse() * world_from_body);
        let sums = (&self.faces[..], &mut self.sums);
        let law = p.force_law();
        ContactSum::of_clay(&probe, shell, sums, self.simd_level, world_from_body, law)
    }

    /// What the clay does to the tool at this pose. RT: safe; twice as much work in the first tick
    /// with a new frame.
    pub(crate) fn touch(
        &mut self,
        clay: &Clay,
        shell: &Shell,
        world_from_body: Pose,
        p: &Parameters,
    ) -> ContactSum {
        let mut sum = self.ask(true, (clay, shell), world_from_body, p);
        let before = core::mem::take(&mut self.is_new)
            .then(|| self.ask(false, (clay, shell), world_from_body, p).wrench);
        if before.is_some() && self.newest.is_leap {
            self.residual.leap(Clay::smoothing_between(LEAP_S, p.period_s));
        }
        sum.become_felt(self.residual.felt(before, sum.wrench, clay.smoothing));
        self.forces = ClayForces {
            contact_world: sum.wrench,
            rope_world: DVec3::ZERO,
            contacts: sum.contacts,
        };
        self.anchor_map = self.newest.rope_map.map(|anchor_map| match self.anchor_map {
            // The anchor leaps with every update: it is averaged like the force.
            Some(felt_map) => felt_map * clay.smoothing + anchor_map * (1.0 - clay.smoothing),
            None => anchor_map,
        });
        if let Some(anchor_map) = self.anchor_map {
            let stretch =
                clay.world_from_map.transform_point(anchor_map) - world_from_body.translation;
            let (pull, stiffness) = clay.rope.pull(stretch);
            self.forces.rope_world = pull.force;
            sum.add_rope(pull, &stiffness);
        }
        sum
    }
}
