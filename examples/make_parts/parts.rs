//! The parts, by name. All lengths in millimetres.

use glam::DVec2;

use crate::gear::Gear;
use crate::loft::{Rectangle, Ring, circle, even_angles, hexagon, loft, solid, square, tip};
use crate::mesh::Mesh;
use crate::thread::{N_COLUMNS, Thread, UNITS_PER_MM};

/// Points around round parts.
const N_AROUND: usize = 128;

pub(crate) const PEG_RADIUS_MM: f64 = 4.0;
pub(crate) const PEG_LENGTH_MM: f64 = 40.0;
pub(crate) const PEG_CHAMFER_MM: f64 = 1.0;
pub(crate) const COLLAR_RADIUS_MM: f64 = 6.5;
pub(crate) const COLLAR_BOTTOM_MM: f64 = 32.0;

pub(crate) const BLOCK_EDGE_MM: f64 = 40.0;
pub(crate) const BLOCK_HEIGHT_MM: f64 = 25.0;
pub(crate) const HOLE_RADIUS_MM: f64 = 4.05;
pub(crate) const HOLE_DEPTH_MM: f64 = 20.0;
pub(crate) const HOLE_CHAMFER_MM: f64 = 0.75;

/// Between shaft and fixed gear: (20 + 30) teeth of half a module. The scene puts the fixed gear
/// there.
#[cfg(test)]
pub(crate) const CENTRE_DISTANCE_MM: f64 = 31.25;
/// Bottom of both gears above the plate when seated: height of the hub and of the shoulder.
pub(crate) const SEAT_MM: f64 = 4.0;
pub(crate) const FACE_WIDTH_MM: f64 = 8.0;
pub(crate) const PLATE: Rectangle = Rectangle { x_mm: [-47.0, 17.0], y_mm: [-24.0, 24.0] };
pub(crate) const PLATE_THICKNESS_MM: f64 = 6.0;
pub(crate) const SHOULDER_RADIUS_MM: f64 = 7.0;
pub(crate) const SHAFT_RADIUS_MM: f64 = 4.0;
pub(crate) const SHAFT_TOP_MM: f64 = 24.0;
pub(crate) const SHAFT_CHAMFER_MM: f64 = 1.0;
pub(crate) const HUB_RADIUS_MM: f64 = 10.0;
pub(crate) const BORE_RADIUS_MM: f64 = 4.1;
pub(crate) const BORE_CHAMFER_MM: f64 = 0.5;
/// Chamfer of the tooth ends: so far inwards, so far along the axis.
pub(crate) const TOOTH_CHAMFER_MM: [f64; 2] = [0.3, 0.6];

pub(crate) const ACROSS_FLATS_MM: f64 = 24.0;
pub(crate) const HEAD_HEIGHT_MM: i64 = 10;
pub(crate) const BOLT_LENGTH_MM: i64 = 40;
/// Radius of the bolt's end face; its chamfer rises from there at 45°.
pub(crate) const BOLT_TIP_RADIUS_MM: f64 = 6.5;
pub(crate) const NUT_HEIGHT_MM: i64 = 13;
pub(crate) const THREAD_CLEARANCE_MM: f64 = 0.15;
/// Radius of the nut's 120° countersinks at its faces.
pub(crate) const NUT_MOUTH_RADIUS_MM: f64 = 8.3;

/// Round peg with a chamfered tip and a collar as its handle; tip face at z = 0, body towards +z.
pub(crate) fn peg() -> Mesh {
    let angles = even_angles(N_AROUND);
    solid(
        &[
            tip(N_AROUND, 0.0),
            circle(&angles, PEG_RADIUS_MM - PEG_CHAMFER_MM, 0.0),
            circle(&angles, PEG_RADIUS_MM, PEG_CHAMFER_MM),
            circle(&angles, PEG_RADIUS_MM, COLLAR_BOTTOM_MM),
            circle(&angles, COLLAR_RADIUS_MM, COLLAR_BOTTOM_MM),
            circle(&angles, COLLAR_RADIUS_MM, PEG_LENGTH_MM),
            tip(N_AROUND, PEG_LENGTH_MM),
        ],
        false,
    )
}

/// Block with a blind hole along z whose mouth is chamfered; top face at z = 0.
pub(crate) fn block_hole() -> Mesh {
    let outline = square(BLOCK_EDGE_MM);
    let angles = outline.angles(N_AROUND);
    let n_points = angles.len();
    solid(
        &[
            tip(n_points, -BLOCK_HEIGHT_MM),
            outline.ring(&angles, -BLOCK_HEIGHT_MM),
            outline.ring(&angles, 0.0),
            circle(&angles, HOLE_RADIUS_MM + HOLE_CHAMFER_MM, 0.0),
            circle(&angles, HOLE_RADIUS_MM, -HOLE_CHAMFER_MM),
            circle(&angles, HOLE_RADIUS_MM, -HOLE_DEPTH_MM),
            tip(n_points, -HOLE_DEPTH_MM),
        ],
        false,
    )
}

/// The same block without its hole: the negative test.
pub(crate) fn block_plugged() -> Mesh {
    let outline = square(BLOCK_EDGE_MM);
    let angles = outline.angles(4);
    let rings = [
        tip(4, -BLOCK_HEIGHT_MM),
        outline.ring(&angles, -BLOCK_HEIGHT_MM),
        outline.ring(&angles, 0.0),
        tip(4, 0.0),
    ];
    solid(&rings, false)
}

/// The fixed gear's numbers: a tooth points along +x, at the shaft.
pub(crate) fn fixed_gear() -> Gear {
    Gear {
        module_mm: 1.25,
        n_teeth: 30,
        pressure_angle: 20.0_f64.to_radians(),
        thinning_mm: 0.1,
        topping_mm: 0.0,
        phase: 0.0,
    }
}

/// The tool gear's numbers: half a tooth of phase puts a space on −x, where the fixed gear's tooth
/// comes from.
pub(crate) fn tool_gear() -> Gear {
    Gear { n_teeth: 20, phase: 9.0_f64.to_radians(), ..fixed_gear() }
}

/// Plate with shoulder and free shaft; the shaft is the z axis, the plate's top z = 0. The fixed
/// gear stands on the −x side.
pub(crate) fn gear_base() -> Mesh {
    let angles = PLATE.angles(N_AROUND);
    let n_points = angles.len();
    solid(
        &[
            tip(n_points, -PLATE_THICKNESS_MM),
            PLATE.ring(&angles, -PLATE_THICKNESS_MM),
            PLATE.ring(&angles, 0.0),
            circle(&angles, SHOULDER_RADIUS_MM, 0.0),
            circle(&angles, SHOULDER_RADIUS_MM, SEAT_MM),
            circle(&angles, SHAFT_RADIUS_MM, SEAT_MM),
            circle(&angles, SHAFT_RADIUS_MM, SHAFT_TOP_MM - SHAFT_CHAMFER_MM),
            circle(&angles, SHAFT_RADIUS_MM - SHAFT_CHAMFER_MM, SHAFT_TOP_MM),
            tip(n_points, SHAFT_TOP_MM),
        ],
        false,
    )
}

/// The four rings of a toothed rim with chamfered tooth ends from `bottom_mm` up, and the angles of
/// its two face rings.
fn rim(gear: &Gear, bottom_mm: f64) -> (Vec<Ring>, Vec<f64>) {
    let [inset_mm, chamfer_mm] = TOOTH_CHAMFER_MM;
    let outline = gear.outline();
    let inset = gear.inset(inset_mm).outline();
    let lift = |points: &[DVec2], z_mm: f64| -> Ring {
        points.iter().map(|point| point.extend(z_mm)).collect()
    };
    let top_mm = bottom_mm + FACE_WIDTH_MM;
    let rings = vec![
        lift(&inset, bottom_mm),
        lift(&outline, bottom_mm + chamfer_mm),
        lift(&outline, top_mm - chamfer_mm),
        lift(&inset, top_mm),
    ];
    (rings, inset.iter().map(|point| point.to_angle()).collect())
}

/// The fixed gear with its hub below; axis z, hub foot at z = 0.
pub(crate) fn gear_fixed() -> Mesh {
    let (rim_rings, angles) = rim(&fixed_gear(), SEAT_MM);
    let n_points = angles.len();
    let mut rings = vec![
        tip(n_points, 0.0),
        circle(&angles, HUB_RADIUS_MM, 0.0),
        circle(&angles, HUB_RADIUS_MM, SEAT_MM),
    ];
    rings.extend(rim_rings);
    rings.push(tip(n_points, SEAT_MM + FACE_WIDTH_MM));
    solid(&rings, false)
}

/// The gear in the hand, with a bore; axis z, bottom face at z = 0.
pub(crate) fn gear_tool() -> Mesh {
    let (mut rings, angles) = rim(&tool_gear(), 0.0);
    let mouth_mm = BORE_RADIUS_MM + BORE_CHAMFER_MM;
    rings.extend([
        circle(&angles, mouth_mm, FACE_WIDTH_MM),
        circle(&angles, BORE_RADIUS_MM, FACE_WIDTH_MM - BORE_CHAMFER_MM),
        circle(&angles, BORE_RADIUS_MM, BORE_CHAMFER_MM),
        circle(&angles, mouth_mm, 0.0),
    ]);
    solid(&rings, true)
}

/// Radius of the bolt where the basic profile has `basic_mm`.
pub(crate) fn bolt_radius_mm(basic_mm: f64, z_mm: f64) -> f64 {
    basic_mm.min(BOLT_TIP_RADIUS_MM + BOLT_LENGTH_MM as f64 - z_mm)
}

/// Radius of the nut's thread where the basic profile has `basic_mm`.
pub(crate) fn nut_radius_mm(basic_mm: f64, z_mm: f64) -> f64 {
    let from_face_mm = z_mm.min(NUT_HEIGHT_MM as f64 - z_mm);
    (basic_mm + THREAD_CLEARANCE_MM).max(NUT_MOUTH_RADIUS_MM - from_face_mm * 3.0_f64.sqrt())
}

/// Bolt: hexagon head from z = 0, thread up to the chamfered tip.
pub(crate) fn bolt() -> Mesh {
    let angles = even_angles(N_COLUMNS);
    let ends = [HEAD_HEIGHT_MM * UNITS_PER_MM, BOLT_LENGTH_MM * UNITS_PER_MM];
    let thread = Thread { ends, shape: bolt_radius_mm };
    let mut mesh = Mesh::default();
    let head = [
        tip(N_COLUMNS, 0.0),
        hexagon(&angles, ACROSS_FLATS_MM, 0.0),
        hexagon(&angles, ACROSS_FLATS_MM, HEAD_HEIGHT_MM as f64),
        thread.ring(ends[0]),
    ];
    loft(&mut mesh, &head, false);
    thread.build(&mut mesh, false);
    loft(&mut mesh, &[thread.ring(ends[1]), tip(N_COLUMNS, BOLT_LENGTH_MM as f64)], false);
    mesh
}

/// Nut: lower face at z = 0. Its thread fits the bolt's wherever its z is a multiple of the pitch
/// and it is not turned.
pub(crate) fn nut() -> Mesh {
    let angles = even_angles(N_COLUMNS);
    let ends = [0, NUT_HEIGHT_MM * UNITS_PER_MM];
    let thread = Thread { ends, shape: nut_radius_mm };
    let mut mesh = Mesh::default();
    let outside = [
        thread.ring(ends[0]),
        hexagon(&angles, ACROSS_FLATS_MM, 0.0),
        hexagon(&angles, ACROSS_FLATS_MM, NUT_HEIGHT_MM as f64),
        thread.ring(ends[1]),
    ];
    loft(&mut mesh, &outside, false);
    thread.build(&mut mesh, true);
    mesh
}
