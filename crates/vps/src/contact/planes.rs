//! Few contacts that stand for many: the deepest point of each direction and place.
//!
//! Data in: contact records, in any number. Data out: at most [`MOST_PLANES`] of them. A record
//! falls into a bin by the direction that it pushes (26 directions: per axis back, none, forth) and
//! by the octant of the tool in which it lies; each bin keeps its deepest point, and those that
//! were its deepest in the ticks before, as long as they touch: which of two points is deeper may
//! change with every step, and with the plane of one alone steps would alternate between both. So a
//! face that rests flat is stood for by its outermost points, an edge by its two sides, and the
//! cost does not depend on what is chosen: O(1) per record, no allocation.
//!
//! # Source
//! Sagardia2014 (few contacts per manifold, deepest first, then far apart) as the idea; the bins
//! are ours.

use glam::Vec3;

use super::Contact;

/// 3³ directions times 8 octants.
pub const N_BINS: usize = 27 * 8;

/// Points of a bin that are known from the ticks before.
const REMEMBERED: usize = 2;

/// Most contacts that are kept.
pub const MOST_PLANES: usize = N_BINS * (1 + REMEMBERED);

/// A component of a unit normal counts as a direction of its own from tan 22.5° on, less than 1/√3:
/// no normal is without any.
const COUNTS_FROM: f32 = 0.41;

/// Of points equally deep, the outer one stands for the place: its depth counts this much of the
/// lever more.
const OUTWARD_PER_M: f32 = 1e-3;

/// Number of an obstacle, and of a point.
type Point = (usize, u32);

/// The deepest contact of every bin.
#[derive(Clone, Debug)]
pub struct DeepestContacts {
    /// Number of the obstacle, and the contact with it: the deepest, and those of `known` that
    /// touch.
    bins: [[Option<(usize, Contact)>; 1 + REMEMBERED]; N_BINS],
    /// The deepest of the ticks before, the last one first.
    known: [[Option<Point>; REMEMBERED]; N_BINS],
}

impl Default for DeepestContacts {
    fn default() -> Self {
        Self { bins: [[None; 1 + REMEMBERED]; N_BINS], known: [[None; REMEMBERED]; N_BINS] }
    }
}

impl DeepestContacts {
    /// A new tick: no contact yet, and of the tick before the points are known that were kept. RT:
    /// safe, O([`N_BINS`]).
    pub fn begin_tick(&mut self) {
        for (bin, known) in self.bins.iter_mut().zip(&mut self.known) {
            let kept = core::mem::take(bin);
            let mut points = kept.iter().flatten().map(point);
            let first = points.next();
            let second = points.find(|point| Some(*point) != first);
            *known = [first, second];
        }
    }

    /// Takes one record. The result depends on the set of records, and on their order only between
    /// points that are equal in depth and lever to the last bit. RT: safe, O(1).
    #[inline]
    pub fn add(&mut self, obstacle_idx: usize, contact: &Contact) {
        let bin = bin(contact.normal_body, contact.arm_body);
        let (Some([deepest, kept @ ..]), Some(known)) =
            (self.bins.get_mut(bin), self.known.get(bin))
        else {
            return;
        };
        for (slot, known) in kept.iter_mut().zip(known) {
            if *known == Some((obstacle_idx, contact.point_idx)) {
                *slot = Some((obstacle_idx, *contact));
            }
        }
        if deepest.is_none_or(|(_, kept)| score(contact) > score(&kept)) {
            *deepest = Some((obstacle_idx, *contact));
        }
    }

    /// The contacts that were kept and their obstacles, in the order of the bins; one that is and
    /// was the deepest comes once.
    pub fn iter(&self) -> impl Iterator<Item = &(usize, Contact)> {
        self.bins.iter().flat_map(|[deepest, kept @ ..]| {
            let deepest = deepest.as_ref();
            let is_other =
                move |other: &&(usize, Contact)| deepest.map(point) != Some(point(other));
            deepest.into_iter().chain(kept.iter().flatten().filter(is_other))
        })
    }
}

fn point((obstacle_idx, contact): &(usize, Contact)) -> Point {
    (*obstacle_idx, contact.point_idx)
}

fn score(contact: &Contact) -> f32 {
    contact.depth_m + OUTWARD_PER_M * contact.arm_body.length()
}

fn bin(normal: Vec3, arm: Vec3) -> usize {
    let direction = |component: f32| {
        if component > COUNTS_FROM { 2 } else { usize::from(component >= -COUNTS_FROM) }
    };
    let side = |component: f32| usize::from(component > 0.0);
    let directions = (direction(normal.x) * 3 + direction(normal.y)) * 3 + direction(normal.z);
    directions * 8 + side(arm.x) * 4 + side(arm.y) * 2 + side(arm.z)
}

#[cfg(test)]
#[expect(clippy::disallowed_types, reason = "test code")]
mod tests {
    use super::*;

    fn contact(point_idx: u32, depth_m: f32, arm_body: Vec3, normal_body: Vec3) -> Contact {
        Contact::of_point(point_idx, depth_m, arm_body, normal_body.normalize())
    }

    #[test]
    fn a_flat_face_is_stood_for_by_its_corners() {
        let mut deepest = DeepestContacts::default();
        let mut point_idx = 0;
        for x in -5..=5_i16 {
            for y in -5..=5_i16 {
                let arm = Vec3::new(f32::from(x) + 0.5, f32::from(y) + 0.5, -5.0) * 1e-3;
                deepest.add(0, &contact(point_idx, 1e-5, arm, Vec3::Z));
                point_idx += 1;
            }
        }
        let kept: Vec<Vec3> = deepest.iter().map(|(_, contact)| contact.arm_body * 1e3).collect();
        assert_eq!(kept.len(), 4);
        for (x, y) in [(5.5, 5.5), (-4.5, 5.5), (5.5, -4.5), (-4.5, -4.5)] {
            assert!(
                kept.iter().any(|arm| (*arm - Vec3::new(x, y, -5.0)).length() < 1e-3),
                "{kept:?}"
            );
        }
    }

    #[test]
    fn the_deepest_of_each_direction_is_kept_whatever_the_order() {
        let contacts: Vec<Contact> = (0..500_u16)
            .map(|n| {
                let t = f32::from(n);
                let (arm, normal) = (
                    Vec3::new((t * 1.3).sin(), (t * 0.7).cos(), (t * 2.1).sin()),
                    Vec3::new(t.sin(), t.cos(), (t * 0.3).sin()),
                );
                contact(u32::from(n), 1e-4 * (2.0 + (t * 5.1).sin()), arm * 1e-2, normal)
            })
            .collect();
        let kept = |order: &mut dyn Iterator<Item = &Contact>| {
            let mut deepest = DeepestContacts::default();
            order.for_each(|contact| deepest.add(0, contact));
            deepest.iter().map(|(_, contact)| contact.point_idx).collect::<Vec<_>>()
        };
        let forth = kept(&mut contacts.iter());
        assert_eq!(forth, kept(&mut contacts.iter().rev()));
        assert!(forth.len() > 26);
        let global = contacts
            .iter()
            .max_by(|a, b| score(a).total_cmp(&score(b)))
            .map(|contact| contact.point_idx);
        assert!(forth.iter().any(|point_idx| Some(*point_idx) == global));
    }

    #[test]
    fn a_point_that_was_the_deepest_is_kept_as_long_as_it_touches() {
        let at = |point_idx: u32, depth_m| contact(point_idx, depth_m, Vec3::X * 1e-3, Vec3::Z);
        let mut deepest = DeepestContacts::default();
        let mut tick = |found: &[(usize, Contact)]| {
            deepest.begin_tick();
            found.iter().for_each(|(obstacle_idx, contact)| deepest.add(*obstacle_idx, contact));
            deepest.iter().map(|(idx, contact)| (*idx, contact.point_idx)).collect::<Vec<_>>()
        };
        assert_eq!(tick(&[(0, at(1, 2e-4)), (0, at(2, 1e-4))]), [(0, 1)]);
        assert_eq!(tick(&[(0, at(1, 1e-4)), (0, at(2, 2e-4))]), [(0, 2), (0, 1)]);
        // From now on both, each once, whichever is deeper.
        assert_eq!(tick(&[(0, at(1, 2e-4)), (0, at(2, 1e-4))]), [(0, 1), (0, 2)]);
        assert_eq!(tick(&[(0, at(1, 2e-4)), (0, at(2, 1e-4))]), [(0, 1), (0, 2)]);
        // Another obstacle's point of that number is another one; the oldest goes.
        let three = [(0, at(1, 2e-4)), (0, at(2, 1e-4)), (1, at(2, 3e-4))];
        assert_eq!(tick(&three), [(1, 2), (0, 1), (0, 2)]);
        assert_eq!(tick(&three), [(1, 2), (0, 1)]);
        // What no longer touches is gone, and is not known when it touches again.
        assert_eq!(tick(&[(0, at(1, 2e-4))]), [(0, 1)]);
        assert_eq!(tick(&three), [(1, 2), (0, 1)]);
        assert_eq!(tick(&[]), []);
        assert_eq!(tick(&[(0, at(1, 1e-4)), (0, at(2, 2e-4))]), [(0, 2)]);
    }

    #[test]
    fn much_deeper_counts_for_more_than_farther_out() {
        let mut deepest = DeepestContacts::default();
        // 100 µm + 5 mm / 1000 = 105 µm, and 50 µm + 50 mm / 1000 = 100 µm.
        let inner = contact(0, 1e-4, Vec3::X * 5e-3, Vec3::Z);
        let outer = contact(1, 5e-5, Vec3::X * 5e-2, Vec3::Z);
        deepest.add(3, &inner);
        deepest.add(4, &outer);
        assert!(deepest.iter().eq(&[(3, inner)]));
    }

    #[test]
    fn of_contacts_alike_in_depth_and_lever_the_first_is_kept() {
        let mut deepest = DeepestContacts::default();
        for point_idx in 0..3 {
            deepest.add(0, &contact(point_idx, 1e-4, Vec3::X, Vec3::Z));
        }
        assert!(deepest.iter().map(|(_, contact)| contact.point_idx).eq([0]));
    }

    #[test]
    fn every_direction_and_octant_has_a_bin_of_its_own() {
        // Directions back, none and forth along x, then y, then z; of each the octants likewise.
        let mut expected = 0;
        for direction in 0..27_u8 {
            let normal = [direction / 9, direction / 3 % 3, direction % 3]
                .map(|code| 0.9 * (f32::from(code) - 1.0));
            for octant in 0..8_u8 {
                let arm = [octant / 4, octant / 2 % 2, octant % 2]
                    .map(|code| 2.0 * f32::from(code) - 1.0);
                assert_eq!(bin(normal.into(), arm.into()), expected, "{normal:?} {arm:?}");
                expected += 1;
            }
        }
        assert_eq!(expected, N_BINS);
    }

    #[test]
    fn the_bound_of_a_direction_is_none_yet_and_the_middle_of_the_tool_is_on_the_low_side() {
        let none = bin(Vec3::ZERO, Vec3::NEG_ONE);
        for normal in [Vec3::splat(COUNTS_FROM), Vec3::splat(-COUNTS_FROM)] {
            assert_eq!(bin(normal, Vec3::NEG_ONE), none);
        }
        assert_eq!(bin(Vec3::ZERO, Vec3::ZERO), none);
    }
}
