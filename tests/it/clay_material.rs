//! Painted material against what the dynamics say in closed form.

use std::f64::consts::PI;

use clay::PointSet;
use clay::clay_model::{ClayModel, Settings};
use clay::dynamics::Material;
use clay::engine::{SculptEngine, SculptOrder, SculptTool, ToolBody, ToolMotion, ToolSettings};
use clay::falloff::Falloff;
use clay::material_map::Painted;
use glam::DVec3;
use vps::spatial::Pose;

/// Half edges of the plate, and what is between its samples and its mass points, m.
const HALF_M: DVec3 = DVec3::new(0.036, 0.018, 0.012);
const SPACING_M: f64 = 1e-3;
const SOFT_N_PER_M: f64 = 50.0;
const STIFF_N_PER_M: f64 = 500.0;
const BRUSH_M: f64 = 4e-3;

fn plate() -> PointSet {
    let mut points = PointSet::default();
    let mut face = |middle: DVec3, u: DVec3, v: DVec3| {
        let n = |edge: DVec3| (2.0 * edge.length() / SPACING_M).round() as usize;
        let along =
            |edge: DVec3, step: usize| edge * ((2 * step + 1) as f64 / n(edge) as f64 - 1.0);
        for (i, j) in (0..n(u)).flat_map(|i| (0..n(v)).map(move |j| (i, j))) {
            points.positions_map.push(middle + along(u, i) + along(v, j));
            points.normals_map.push(middle.normalize());
            points.colors.push([200; 3]);
        }
    };
    let [x, y, z] = [DVec3::X * HALF_M.x, DVec3::Y * HALF_M.y, DVec3::Z * HALF_M.z];
    for side in [-1.0, 1.0] {
        face(x * side, y, z);
        face(y * side, x, z);
        face(z * side, x, y);
    }
    points
}

fn tool(kind: SculptTool, brush_m: f64, falloff: Falloff) -> ToolSettings {
    let painted = Painted { stiffness_n_per_m: Some(STIFF_N_PER_M as f32), ..Painted::default() };
    ToolSettings { kind, brush_m, falloff, painted, ..ToolSettings::default() }
}

/// A force straight down at a place of the upper side, for some updates.
fn press(
    engine: &mut SculptEngine,
    (x_m, y_m): (f64, f64),
    force_n: f64,
    (n_updates, update_s): (usize, f64),
) {
    for _ in 0..n_updates {
        engine.take_motion(&ToolMotion {
            map_from_tool: Pose::from_translation(DVec3::new(x_m, y_m, HALF_M.z)),
            force_map: DVec3::Z * force_n,
            touches: force_n > 0.0,
            has_force: true,
            ..ToolMotion::default()
        });
        engine.advance(update_s);
    }
}

/// At rest K (d − d₀) = f: with springs of k between neighbours h apart, the dent is a potential,
/// (k/h) ∇²u = −f per volume. A Gaussian force F, its standard deviation σ a third of the brush,
/// dents by F h/(4π k) √(2/π)/σ at its middle. The border between both halves, L away, adds an
/// image at 2 L with the share (k₁ − k₂)/(k₁ + k₂), as at the border of two dielectrics. The held
/// rim of the region, which the formula leaves out, takes a little off the image.
fn dent_m(force_n: f64, own_n_per_m: f64, other_n_per_m: f64, from_border_m: f64) -> f64 {
    let image =
        (own_n_per_m - other_n_per_m) / (own_n_per_m + other_n_per_m) / (2.0 * from_border_m);
    force_n * SPACING_M / (4.0 * PI * own_n_per_m) * ((2.0 / PI).sqrt() / (BRUSH_M / 3.0) + image)
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn the_half_of_a_plate_that_is_ten_times_as_stiff_dents_as_the_springs_say() {
    let region = DVec3::new(0.032, 0.016, 0.016);
    let settings = Settings {
        region_map: Some((DVec3::Z * HALF_M.z - region, DVec3::Z * HALF_M.z + region)),
        raster: [65, 33, 33],
        air_m: 4e-3,
        material: Material {
            stiffness_n_per_m: SOFT_N_PER_M as f32,
            creep_s: f64::INFINITY,
            ..Material::default()
        },
        ..Settings::default()
    };
    let model = ClayModel::new(plate(), settings).expect("a clay model");
    let mut engine = SculptEngine::new(
        model,
        tool(SculptTool::Material, 0.02, Falloff::Constant),
        ToolBody::default(),
    );
    // A wide brush goes over the left half.
    for (x, y) in (0..9).flat_map(|x| (-2..=2).map(move |y| (x, y))) {
        press(&mut engine, (-0.02 - 2e-3 * f64::from(x), 5e-3 * f64::from(y)), 2.0, (1, 0.01));
    }
    engine
        .order(SculptOrder::Take(tool(SculptTool::Push, BRUSH_M, Falloff::Gaussian)))
        .expect("taken");
    assert_eq!(engine.model().history(), (1, 0), "{}", engine.trouble());
    for x in -20..=20 {
        let stiffness = engine
            .model()
            .material_at(DVec3::new(1e-3 * f64::from(x), 0.0, HALF_M.z))
            .stiffness_n_per_m;
        assert_eq!(
            f64::from(stiffness),
            if x <= 0 { STIFF_N_PER_M } else { SOFT_N_PER_M },
            "at {x} mm"
        );
    }

    let force_n = 0.1;
    let from_border_m = 0.012;
    let mut dent = |x_m: f64| {
        // Any step is stable: three seconds are enough for all of it to come to rest.
        press(&mut engine, (x_m, 0.0), force_n, (60, 0.05));
        let upwards = engine
            .model()
            .onto_along(DVec3::new(x_m, 0.0, HALF_M.z), DVec3::Z, 4e-3)
            .expect("a surface");
        engine.order(SculptOrder::Undo).expect("undone");
        HALF_M.z - upwards.z
    };
    let stiff_m = dent(-from_border_m);
    let soft_m = dent(from_border_m);
    let expected_stiff_m = dent_m(force_n, STIFF_N_PER_M, SOFT_N_PER_M, from_border_m);
    let expected_soft_m = dent_m(force_n, SOFT_N_PER_M, STIFF_N_PER_M, from_border_m);
    for (found_m, expected_m) in [(stiff_m, expected_stiff_m), (soft_m, expected_soft_m)] {
        assert!((found_m / expected_m - 1.0).abs() < 0.1, "{found_m} m, expected {expected_m} m");
    }
    // Without a border it would be ten; with an image that nothing takes off, 8.9.
    let ratio = soft_m / stiff_m;
    assert!((expected_soft_m / expected_stiff_m..10.0).contains(&ratio), "{ratio}");
}
