//! A ventilated brake disc with hub, caliper, strut and spring: an assembly of some hundred closed
//! parts.
//!
//! The paper's brake has 28.5 times the points at a quarter of the voxel size, where a smooth
//! surface has 16 times: much of its surface is closer together than six units. So the vanes
//! between the friction rings are here.

use core::f64::consts::TAU;

use glam::{DAffine3, DVec2, DVec3};

use super::super::random::Random;
use super::solids::{Assembly, ring};
use vps::mesh::TriangleMesh;

const BOX_MM: DVec3 = DVec3::new(298.6, 299.6, 417.6);
const N_TRIANGLES: usize = 24_250;
const DISC_RADIUS: f64 = 149.8;
const RING_INNER_RADIUS: f64 = 106.0;
/// Where the disc begins and ends along its axis, and the friction rings in it.
const DISC: [f64; 2] = [190.0, 206.0];
const RING_THICKNESS: f64 = 4.0;
const N_VANES: usize = 180;

/// An assembly of 24,250 triangles.
pub(super) fn brake(random: &mut Random) -> TriangleMesh {
    let mut assembly = Assembly::default();
    // z of the parts is the axis of the disc: x.
    let axle = DAffine3::from_cols(
        DVec3::Y,
        DVec3::Z,
        DVec3::X,
        DVec3::new(0.0, DISC_RADIUS, DISC_RADIUS),
    );
    disc(&mut assembly, axle, random);
    hub(&mut assembly, axle, random);
    caliper(&mut assembly, axle);
    strut(&mut assembly, random);
    let mut turn = 0.0;
    assembly.rivets_up_to(N_TRIANGLES, 12, 2.5, || {
        turn += 0.4 + random.within(0.0, 0.02);
        axle.transform_point3(
            (DVec2::from_angle(turn) * random.within(18.0, 43.0)).extend(DISC[0] + 2.0),
        )
    });
    assembly.fitted(BOX_MM)
}

fn disc(assembly: &mut Assembly, axle: DAffine3, random: &mut Random) {
    let phase = random.within(0.0, TAU);
    let mut holes = vec![ring(DVec2::ZERO, RING_INNER_RADIUS, 128)];
    holes.extend((0..36).map(|k| {
        let radius = [114.0, 126.0, 138.0][k % 3];
        ring(DVec2::from_angle(phase + TAU * k as f64 / 36.0) * radius, random.within(2.6, 3.4), 8)
    }));
    for low in [DISC[0], DISC[1] - RING_THICKNESS] {
        assembly.plate(
            axle,
            &ring(DVec2::ZERO, DISC_RADIUS, 192),
            &holes,
            [low, low + RING_THICKNESS],
        );
    }
    // Vanes reach half a unit into the rings on both sides.
    let middle = 0.5 * (DISC[0] + DISC[1]);
    let half_length = 0.5 * (DISC_RADIUS - RING_INNER_RADIUS) - 1.5;
    for k in 0..N_VANES {
        let turn = DAffine3::from_rotation_z(
            TAU * k as f64 / N_VANES as f64 + random.within(-0.002, 0.002),
        );
        let place = axle
            * turn
            * DAffine3::from_translation(DVec3::new(
                0.5 * (DISC_RADIUS + RING_INNER_RADIUS),
                0.0,
                middle,
            ));
        assembly
            .cuboid(place, DVec3::new(half_length, 0.75, middle - DISC[0] - RING_THICKNESS + 0.5));
    }
}

fn hub(assembly: &mut Assembly, axle: DAffine3, random: &mut Random) {
    // A floating disc: arms from the flange of the hub, pinned to the inner rim.
    let flange = DISC[0] + 2.0;
    assembly.cylinder(axle, 45.0, [flange, flange + 10.0], 96);
    for k in 0..8 {
        let turn = DAffine3::from_rotation_z(TAU * f64::from(k) / 8.0 + random.within(-0.02, 0.02));
        let arm = axle * turn * DAffine3::from_translation(DVec3::new(74.0, 0.0, flange + 5.0));
        assembly.cuboid(arm, DVec3::new(34.0, 6.0, 4.0));
    }
    assembly.cylinder(axle, 9.0, [0.0, BOX_MM.x], 48);
    assembly.tube(axle, [8.0, 24.0], [DISC[0] - 60.0, DISC[0] - 30.0], 48);
    let phase = random.within(0.0, TAU);
    for k in 0..5 {
        let arm = DVec2::from_angle(phase + TAU * f64::from(k) / 5.0) * 32.0;
        let place = axle * DAffine3::from_translation(arm.extend(flange));
        assembly.cylinder(place, 4.0, [-4.0, 30.0], 32);
        assembly.cylinder(place, 7.0, [9.0, 17.0], 6);
    }
}

fn caliper(assembly: &mut Assembly, axle: DAffine3) {
    // A C over the rim, its hollow towards the axle; drawn in (along the axle, away from it).
    let [low, high] = DISC;
    let outline: Vec<DVec2> = [
        (low - 34.0, 106.0),
        (low - 12.0, 106.0),
        (low - 12.0, 156.0),
        (high + 12.0, 156.0),
        (high + 12.0, 106.0),
        (high + 28.0, 106.0),
        (high + 28.0, 170.0),
        (low - 34.0, 170.0),
    ]
    .map(DVec2::from)
    .to_vec();
    let pins: Vec<Vec<DVec2>> =
        [low - 24.0, high + 20.0].map(|x| ring(DVec2::new(x, 162.0), 4.0, 24)).to_vec();
    // Above the axle, along y.
    let center = axle.transform_point3(DVec3::ZERO);
    let place = DAffine3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y, center);
    assembly.plate(place, &outline, &pins, [-38.0, 38.0]);
    for (from, to) in [(low - 13.0, low - 0.4), (high + 0.4, high + 13.0)] {
        let pad =
            DAffine3::from_translation(DVec3::new(0.5 * (from + to), center.y, center.z + 128.0));
        assembly.cuboid(pad, DVec3::new(0.5 * (to - from), 32.0, 17.0));
    }
    for y in [-22.0, 22.0] {
        let piston = axle * DAffine3::from_translation(DVec3::new(y, 130.0, 0.0));
        assembly.cylinder(piston, 15.0, [low - 40.0, low - 11.0], 64);
    }
}

fn strut(assembly: &mut Assembly, random: &mut Random) {
    let foot = DVec3::new(110.0, DISC_RADIUS, DISC_RADIUS);
    let upright = DAffine3::from_translation(foot);
    // The knuckle holds hub and strut.
    assembly.cuboid(
        upright * DAffine3::from_translation(DVec3::Z * 20.0),
        DVec3::new(16.0, 22.0, 45.0),
    );
    assembly.cylinder(upright, 9.0, [50.0, BOX_MM.z - foot.z], 48);
    assembly.cylinder(upright, 24.0, [175.0, 180.0], 96);
    let turns = 4.5;
    let wire: Vec<DVec3> = (0..=220)
        .map(|k| {
            let share = f64::from(k) / 220.0;
            foot + (DVec2::from_angle(TAU * turns * share) * 18.0).extend(182.0 + 60.0 * share)
        })
        .collect();
    assembly.bar(&wire, 3.5, 12);
    let sway = random.within(8.0, 16.0);
    let hose: Vec<DVec3> = (0..=160)
        .map(|k| {
            let share = f64::from(k) / 160.0;
            foot + DVec3::new(
                50.0 - 30.0 * share,
                30.0 + sway * (9.0 * share).sin(),
                150.0 + 110.0 * share,
            )
        })
        .collect();
    assembly.bar(&hose, 3.0, 12);
}
