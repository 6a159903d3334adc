//! The front half of a car: panels, wheels, springs, seats, engine, wires, bolts and rivets. Some
//! thirty thousand closed parts of mostly small triangles, the sheets far thinner than the voxels.

use core::f64::consts::{PI, TAU};

use glam::{DAffine3, DQuat, DVec2, DVec3};

use super::super::random::Random;
use super::solids::Assembly;
use vps::mesh::TriangleMesh;

const BOX_MM: DVec3 = DVec3::new(1494.0, 1770.0, 2038.0);
const N_TRIANGLES: usize = 3_024_230;
const SHEET_MM: f64 = 1.2;
/// Edge of a panel's triangles.
const MESH_MM: f64 = 6.0;
const N_BOLTS: usize = 6000;
const N_WIRES: usize = 48;

/// An assembly of 3,024,230 triangles. x is up, y to the side, z from the bumper backwards.
pub(super) fn car(random: &mut Random) -> TriangleMesh {
    let mut assembly = Assembly::default();
    let panels = panels(random);
    for panel in &panels {
        assembly.sheet(panel.steps(), SHEET_MM, |u, v| panel.at(u, v));
    }
    for side in [-1.0, 1.0] {
        wheel(&mut assembly, DVec3::new(312.0, 885.0 + side * 770.0, 420.0), side, random);
        seat(&mut assembly, DVec3::new(330.0, 885.0 + side * 370.0, 1150.0));
    }
    engine(&mut assembly, random);
    for _ in 0..N_WIRES {
        wire(&mut assembly, random);
    }
    for k in 0..N_BOLTS {
        bolt(&mut assembly, panels[k % panels.len()].on_rim(random), random);
    }
    let mut k = 0;
    assembly.rivets_up_to(N_TRIANGLES, 16, 3.0, || {
        k += 1;
        panels[k % panels.len()].on_rim(random)
    });
    assembly.fitted(BOX_MM)
}

/// A sheet between four corners, bulged, with beads pressed into it.
struct Panel {
    /// At (u, v) = (0, 0), (1, 0), (1, 1), (0, 1); outward by the right hand.
    corners: [DVec3; 4],
    bulge: f64,
    bead: f64,
    n_beads: f64,
}

impl Panel {
    fn at(&self, u: f64, v: f64) -> DVec3 {
        let [a, b, c, d] = self.corners;
        let flat = a.lerp(b, u).lerp(d.lerp(c, u), v);
        let outward = (b - a).cross(d - a).normalize();
        flat + outward
            * (self.bulge * 16.0 * u * (1.0 - u) * v * (1.0 - v)
                + self.bead * (PI * self.n_beads * v).sin().powi(2))
    }

    fn steps(&self) -> [usize; 2] {
        let [a, b, c, d] = self.corners;
        [(a.distance(b) + d.distance(c), 2.0), (a.distance(d) + b.distance(c), 2.0)]
            .map(|(length, n)| ((length / n / MESH_MM) as usize).max(2))
    }

    /// A place near the rim, where parts are joined.
    fn on_rim(&self, random: &mut Random) -> DVec3 {
        let along = random.within(0.02, 0.98);
        let inset = random.within(0.02, 0.05);
        let (u, v) = [(along, inset), (along, 1.0 - inset), (inset, along), (1.0 - inset, along)]
            [(random.unit() * 4.0) as usize];
        self.at(u, v)
    }
}

fn panels(random: &mut Random) -> Vec<Panel> {
    let mut panels = Vec::new();
    let mut add = |corners: [[f64; 3]; 4], bulge: f64, bead: f64, n_beads: f64| {
        let bulge = bulge * random.within(0.95, 1.05);
        panels.push(Panel { corners: corners.map(DVec3::from_array), bulge, bead, n_beads });
    };
    // Floor, firewall, hood, windscreen, roof, bumper.
    add(
        [
            [180.0, 120.0, 640.0],
            [180.0, 1650.0, 640.0],
            [180.0, 1650.0, 2038.0],
            [180.0, 120.0, 2038.0],
        ],
        12.0,
        9.0,
        14.0,
    );
    add(
        [
            [180.0, 120.0, 640.0],
            [900.0, 120.0, 640.0],
            [900.0, 1650.0, 640.0],
            [180.0, 1650.0, 640.0],
        ],
        10.0,
        6.0,
        9.0,
    );
    add(
        [
            [760.0, 140.0, 40.0],
            [760.0, 1630.0, 40.0],
            [920.0, 1600.0, 690.0],
            [920.0, 170.0, 690.0],
        ],
        35.0,
        0.0,
        1.0,
    );
    add(
        [
            [910.0, 190.0, 640.0],
            [910.0, 1580.0, 640.0],
            [1450.0, 1480.0, 1010.0],
            [1450.0, 290.0, 1010.0],
        ],
        25.0,
        0.0,
        1.0,
    );
    add(
        [
            [1460.0, 280.0, 1000.0],
            [1460.0, 1490.0, 1000.0],
            [1470.0, 1490.0, 1820.0],
            [1470.0, 280.0, 1820.0],
        ],
        24.0,
        3.0,
        5.0,
    );
    add(
        [[190.0, 60.0, 25.0], [190.0, 1710.0, 25.0], [640.0, 1690.0, 40.0], [640.0, 80.0, 40.0]],
        -14.0,
        8.0,
        3.0,
    );
    for side in [0.0, 1.0] {
        // Fender, door, wheel arch. The mirror image turns the other way, so its corners are listed
        // backwards.
        let mut add_side = |mut corners: [[f64; 3]; 4], bulge: f64, bead: f64, n_beads: f64| {
            if side > 0.5 {
                for corner in &mut corners {
                    corner[1] = BOX_MM.y - corner[1];
                }
                corners.reverse();
            }
            add(corners, bulge, bead, n_beads);
        };
        add_side(
            [
                [560.0, 28.0, 30.0],
                [560.0, 28.0, 720.0],
                [910.0, 120.0, 700.0],
                [750.0, 110.0, 40.0],
            ],
            20.0,
            0.0,
            1.0,
        );
        add_side(
            [
                [230.0, 18.0, 730.0],
                [230.0, 18.0, 1960.0],
                [920.0, 60.0, 1960.0],
                [920.0, 60.0, 730.0],
            ],
            16.0,
            5.0,
            3.0,
        );
        add_side(
            [
                [640.0, 90.0, 90.0],
                [640.0, 350.0, 90.0],
                [660.0, 350.0, 740.0],
                [660.0, 90.0, 740.0],
            ],
            50.0,
            2.0,
            4.0,
        );
    }
    panels
}

fn wheel(assembly: &mut Assembly, center: DVec3, side: f64, random: &mut Random) {
    // z of the parts points out of the car. The turn keeps the places of the two wheels' corners
    // apart from any symmetry.
    let place = DAffine3::from_rotation_translation(
        DQuat::from_rotation_arc(DVec3::Z, DVec3::Y * side),
        center,
    ) * DAffine3::from_rotation_z(random.within(0.0, TAU));
    let profile: Vec<DVec2> = (0..72)
        .map(|k| {
            let turn = DVec2::from_angle(TAU * f64::from(k) / 72.0);
            // Flat tread with grooves.
            let groove = if turn.x > 0.7 && k % 6 < 2 { 7.0 } else { 0.0 };
            DVec2::new(
                252.0 + turn.x.signum() * turn.x.abs().powf(0.6) * 60.0 - groove,
                turn.y * 92.0,
            )
        })
        .collect();
    assembly.revolved(place, &profile, 320);
    let rim = [
        (150.0, -80.0),
        (196.0, -80.0),
        (188.0, 0.0),
        (196.0, 84.0),
        (186.0, 84.0),
        (178.0, 0.0),
        (178.0, -70.0),
        (150.0, -74.0),
    ];
    assembly.revolved(place, &rim.map(DVec2::from), 320);
    assembly.tube(place, [30.0, 150.0], [-50.0, -34.0], 240);
    for k in 0..9 {
        let spoke = DAffine3::from_rotation_z(TAU * f64::from(k) / 9.0)
            * DAffine3::from_translation(DVec3::new(110.0, 0.0, 40.0));
        assembly.cushion(place * spoke, DVec3::new(80.0, 16.0, 12.0), 48);
    }
    assembly.cylinder(place, 60.0, [-90.0, 50.0], 180);
    // Strut and spring stand inboard of the wheel.
    let foot = center + DVec3::new(120.0, -side * 170.0, 0.0);
    assembly.cylinder(
        DAffine3::from_rotation_translation(DQuat::from_rotation_y(PI / 2.0), foot),
        24.0,
        [0.0, 420.0],
        64,
    );
    let coil: Vec<DVec3> = (0..=1500)
        .map(|k| {
            let share = f64::from(k) / 1500.0;
            let around = DVec2::from_angle(TAU * 7.0 * share) * 62.0;
            foot + DVec3::new(90.0 + 310.0 * share, around.x, around.y)
        })
        .collect();
    assembly.bar(&coil, 7.0, 20);
}

fn seat(assembly: &mut Assembly, foot: DVec3) {
    let cushion = DAffine3::from_translation(foot + DVec3::new(60.0, 0.0, 0.0));
    assembly.cushion(cushion, DVec3::new(70.0, 250.0, 260.0), 240);
    let lean = DAffine3::from_rotation_translation(
        DQuat::from_rotation_y(-0.35),
        foot + DVec3::new(400.0, 0.0, 330.0),
    );
    assembly.cushion(lean, DVec3::new(320.0, 240.0, 60.0), 240);
    let head = DAffine3::from_translation(foot + DVec3::new(800.0, 0.0, 450.0));
    assembly.cushion(head, DVec3::new(85.0, 130.0, 50.0), 120);
}

fn engine(assembly: &mut Assembly, random: &mut Random) {
    let block = DVec3::new(480.0, 820.0, 380.0);
    assembly.cuboid(DAffine3::from_translation(block), DVec3::new(160.0, 290.0, 150.0));
    assembly.cushion(
        DAffine3::from_translation(block + DVec3::new(190.0, 0.0, 0.0)),
        DVec3::new(60.0, 270.0, 110.0),
        200,
    );
    let gearbox = DAffine3::from_rotation_translation(
        DQuat::from_rotation_x(-PI / 2.0),
        block + DVec3::new(-60.0, 290.0, 0.0),
    );
    assembly.cylinder(gearbox, 130.0, [-20.0, 260.0], 200);
    for k in 0..4 {
        let port = block + DVec3::new(140.0, -200.0 + 130.0 * f64::from(k), 130.0);
        let bend = random.within(0.9, 1.1);
        let pipe: Vec<DVec3> = (0..=120)
            .map(|step| {
                let share = f64::from(step) / 120.0;
                port + DVec3::new(
                    -320.0 * share * share,
                    60.0 * bend * (PI * share).sin(),
                    110.0 * (PI * 0.5 * share).sin(),
                )
            })
            .collect();
        assembly.bar(&pipe, 22.0, 48);
    }
    // Radiator: tanks, tubes, fins between them.
    for y in [470.0, 1240.0] {
        assembly.cuboid(
            DAffine3::from_translation(DVec3::new(500.0, y, 130.0)),
            DVec3::new(210.0, 20.0, 24.0),
        );
    }
    for row in 0..40 {
        let x = 300.0 + 10.2 * f64::from(row);
        assembly.cuboid(
            DAffine3::from_translation(DVec3::new(x, 855.0, 130.0)),
            DVec3::new(1.2, 370.0, 18.0),
        );
        for k in 0..120 {
            let y = 492.0 + 6.1 * f64::from(k) + random.within(-0.4, 0.4);
            assembly.cuboid(
                DAffine3::from_translation(DVec3::new(x + 5.1, y, 130.0)),
                DVec3::new(4.2, 0.2, 16.0),
            );
        }
    }
}

/// One wire of the harness, from the engine bay through the firewall.
fn wire(assembly: &mut Assembly, random: &mut Random) {
    let from = DVec3::new(
        random.within(620.0, 700.0),
        random.within(500.0, 700.0),
        random.within(250.0, 450.0),
    );
    let to = DVec3::new(
        random.within(640.0, 740.0),
        random.within(1000.0, 1300.0),
        random.within(700.0, 760.0),
    );
    let sag = random.within(20.0, 80.0);
    let phase = random.within(0.0, TAU);
    let path: Vec<DVec3> = (0..=360)
        .map(|k| {
            let share = f64::from(k) / 360.0;
            let ripple =
                DVec3::new((phase + 21.0 * share).sin(), (phase + 17.0 * share).cos(), 0.0) * 6.0;
            from.lerp(to, share) + ripple - DVec3::X * sag * (PI * share).sin()
        })
        .collect();
    assembly.bar(&path, random.within(2.0, 4.0), 12);
}

fn bolt(assembly: &mut Assembly, at: DVec3, random: &mut Random) {
    let turn = DQuat::from_rotation_x(random.within(0.0, TAU))
        * DQuat::from_rotation_y(random.within(0.0, TAU));
    let place = DAffine3::from_rotation_translation(turn, at);
    assembly.cylinder(place, 5.0, [0.0, 4.0], 6);
    assembly.cylinder(place, 2.5, [-14.0, 2.0], 12);
}
