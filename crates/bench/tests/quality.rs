//! Acceptance test 19: Q1 to Q3 with CSV output, and the fields beside exact distances. Figures:
//! `bench contact --quality`.
#![expect(clippy::print_stderr, reason = "tests say what they skip and measure")]

use std::path::{Path, PathBuf};

use bench::contact::clay::Receding;
use bench::contact::fields::{Depths, Measured, measure};
use bench::contact::scenarios::{self, Ideal};
use bench::contact::sliding::{self, DEPTHS_VOXELS, ripple_percent};
use bench::contact::{Csv, FieldErrors, field_errors};
use haptics::CouplingMode;
use vps::mesh::primitives::Shape;
use vps::voxmap::field::FieldKind;

/// Bounds: what was measured over whole paths (1,200 ticks), times two to five.
const TRILINEAR: Depths = Depths::Of(FieldKind::Trilinear);
const RAW: Depths = Depths::Of(FieldKind::Layers);

fn tell(measured: &Measured) {
    let Measured {
        family,
        path,
        depths,
        contacts,
        angle_deg,
        magnitude_percent,
        bias_percent,
        ripple_percent,
        torque_voxels,
        ..
    } = measured;
    eprintln!(
        "{family}, {path}, {}: {contacts:.0} contacts, angle {angle_deg:.3?}, magnitude \
            {magnitude_percent:.3?}, bias {bias_percent:.2?} %, ripple {ripple_percent:.4?} %, \
            torque {torque_voxels:.3?}",
        depths.name()
    );
}

#[test]
fn acceptance_19_forces_beside_analytic_ones() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut csv = Csv::new(Some(folder.path().join("quality"))).expect("a folder");
    let scenarios = scenarios::all(400).expect("baked");
    let all = measure(&scenarios, &mut csv).expect("written");
    assert_eq!(all.len(), 8 * Depths::ALL.len());
    all.iter().for_each(tell);
    for scenario in &scenarios {
        let of = |depths: Depths| {
            let found = all
                .iter()
                .find(|m| (m.family, m.path, m.depths) == (scenario.family, scenario.path, depths));
            found.expect("measured")
        };
        let name = format!("{}, {}", scenario.family, scenario.path);
        let exact = of(Depths::Exact);
        let raw = of(RAW);
        let ripple = |m: &Measured| m.ripple_percent.expect("long enough");
        for depths in
            [Depths::Of(FieldKind::SurfacePoint), Depths::Of(FieldKind::Octant), TRILINEAR]
        {
            let found = of(depths);
            let name = format!("{name}, {}", depths.name());
            match scenario.ideal {
                // The distance to a plane is linear, so these three are exact but for rounding:
                // what is left is the shell's.
                Ideal::Along(_) => {
                    let angle_deg = |m: &Measured| m.angle_deg.expect("a direction").max;
                    assert!(
                        (angle_deg(found) - angle_deg(exact)).abs() < 1e-4,
                        "{name}: {} °",
                        angle_deg(found)
                    );
                    assert!(
                        found.magnitude_percent.max < 2e-3,
                        "{name}: {:?}",
                        found.magnitude_percent
                    );
                    assert!(
                        found.bias_percent.expect("a force").abs() < 1e-3,
                        "{name}: {:?}",
                        found.bias_percent
                    );
                    assert!(
                        (found.torque_voxels.max - exact.torque_voxels.max).abs() < 1e-4,
                        "{name}: {:?}",
                        found.torque_voxels
                    );
                    assert!(
                        ripple(found) < 1e-3 && ripple(raw) > 100.0 * ripple(found),
                        "{name}: {} of {}",
                        ripple(found),
                        ripple(raw)
                    );
                }
                Ideal::Zero => {
                    let most = if depths == TRILINEAR { [0.5, 0.05] } else { [1.5, 0.1] };
                    assert!(
                        found.magnitude_percent.max < most[0],
                        "{name}: {:?}",
                        found.magnitude_percent
                    );
                    assert!(found.torque_voxels.max < most[1], "{name}: {:?}", found.torque_voxels);
                    let least = if depths == TRILINEAR { 10.0 } else { 3.0 };
                    assert!(
                        ripple(raw) > least * ripple(found),
                        "{name}: {} of {}",
                        ripple(found),
                        ripple(raw)
                    );
                }
            }
        }
        if scenario.family.starts_with("Q1") {
            // 337 points: the sphere's own shell is good to a hundredth of a degree.
            assert!(
                exact.angle_deg.expect("a direction").max < 0.01,
                "{name}: {:?}",
                exact.angle_deg
            );
        }
    }
    for (file, lines) in [("q1-q3.csv", all.len()), ("q1-q3-series.csv", 400 * all.len())] {
        let written =
            std::fs::read_to_string(folder.path().join("quality").join(file)).expect("a file");
        assert_eq!(written.lines().count(), lines + 1, "{file}");
    }
}

fn reported(name: &str, errors: &[FieldErrors]) -> [bench::Spread; 4] {
    for FieldErrors { field, voxels } in errors {
        eprintln!("{name}, {field:?}: {voxels:.4?} voxels");
    }
    [FieldKind::Layers, FieldKind::SurfacePoint, FieldKind::Octant, FieldKind::Trilinear]
        .map(|kind| errors.iter().find(|errors| errors.field == kind).expect("every field").voxels)
}

/// What holds near every mesh that was measured, edges included, within two voxels of the surface.
/// Measured: trilinear mean at most 0.031, max 0.44 voxels; octant 0.031, 0.45; surface-point
/// 0.015, 0.94; layers 0.37, 1.54.
fn assert_sane(name: &str, [layers, surface_point, octant, trilinear]: [bench::Spread; 4]) {
    assert!(trilinear.mean < 0.06 && trilinear.max < 0.75, "{name}: trilinear {trilinear:?}");
    assert!(octant.mean < 0.06 && octant.max < 0.9, "{name}: octant {octant:?}");
    assert!(
        surface_point.mean < 0.04 && surface_point.max < 1.5,
        "{name}: surface-point {surface_point:?}"
    );
    assert!(layers.mean < 0.6 && layers.max < 2.2, "{name}: layers {layers:?}");
    assert!(layers.mean > 2.0 * trilinear.mean, "{name}: the raw field must show its voxels");
}

#[test]
fn acceptance_19_fields_of_shapes_beside_exact_distances() {
    let shapes = [
        ("sphere", Shape::Sphere { radius_m: 0.02 }),
        ("torus", Shape::Torus { major_m: 0.03, minor_m: 0.008 }),
        ("cone", Shape::Cone { radius_m: 0.02, height_m: 0.03 }),
        ("box", Shape::Box { size_m: glam::DVec3::new(0.03, 0.02, 0.025) }),
    ];
    for (name, shape) in shapes {
        let mesh = shape.tessellate(2e-5);
        let errors = reported(name, &field_errors(name, &mesh, 1e-3, 1000).expect("baked"));
        assert_sane(name, errors);
        if ["sphere", "torus"].contains(&name) {
            let [_, surface_point, octant, trilinear] = errors;
            // Without edges: measured 0.03, 0.04 and 0.07 voxels.
            assert!(
                trilinear.max < 0.08 && octant.max < 0.1 && surface_point.max < 0.15,
                "{name}: {errors:?}"
            );
        }
    }
}

#[test]
fn acceptance_19_fields_of_real_meshes_beside_exact_distances() {
    let Some(folder) = std::env::var_os("HAPTICD_MODELS").map(PathBuf::from) else {
        return eprintln!("skipped: HAPTICD_MODELS not set");
    };
    for (name, metres_per_unit) in [
        ("rocker-arm.obj", 1.0),
        ("factory_round_peg_8mm_tight.obj", 1.0),
        ("featuretype.STL", 0.0254),
    ] {
        let mesh = vps::mesh::load(&folder.join(name), metres_per_unit).expect("a mesh");
        let (low, high) = mesh.bounds().expect("not empty");
        assert_sane(
            name,
            reported(
                name,
                &field_errors(name, &mesh, (high - low).max_element() / 118.0, 1000)
                    .expect("baked"),
            ),
        );
    }
}

/// The force law alone, in every shipped scene. On the hand of a simulated arm the steps of its
/// encoder are the floor: `bench contact --quality` has both.
#[test]
fn sliding_over_every_shipped_scene_is_ten_times_smoother_than_the_raw_force() {
    let slides = sliding::slides(
        &Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/scenes"),
        &DEPTHS_VOXELS[..1],
    )
    .expect("baked");
    assert_eq!(slides.len(), 4, "a slide for every shipped scene");
    for slid in &slides {
        let [raw, unfiltered, shipped] = [&slid.raw, &slid.unfiltered, &slid.shipped]
            .map(|forces| ripple_percent(forces).expect("a force"));
        let times = slid.times_smoother().expect("a ripple");
        let delay_ms = slid.delay_s * 1e3;
        let stated_ms = slid.stated_delay_s * 1e3;
        eprintln!(
            "{}: ripple {raw:.3} % raw, {unfiltered:.4} % without the low-pass, {shipped:.4} % as \
                shipped: 1/{times:.0}; late by {delay_ms:.2} of {stated_ms:.2} ms",
            slid.scene
        );
    }
    for slid in &slides {
        assert!(slid.times_smoother() >= Some(10.0), "{}: {:?}", slid.scene, slid.times_smoother());
        assert!(
            slid.delay_s > 0.0 && slid.delay_s <= slid.stated_delay_s,
            "{}: {} s",
            slid.scene,
            slid.delay_s
        );
    }
}

/// The force between updates; `bench sculpt` draws the same series.
#[test]
fn extrapolation_takes_the_steps_out_of_receding_clay() {
    for coupling in [CouplingMode::Direct, CouplingMode::Implicit] {
        // An update moves the surface by 0.83, 0.2 and 0.1 mm.
        for (update_hz, most_share) in [(60.0, 0.25), (250.0, 0.5), (500.0, 0.75)] {
            let play = |extrapolates| {
                Receding { speed_m_per_s: 0.05, update_hz, extrapolates, coupling }
                    .play(600)
                    .expect("sound frames")
            };
            let stepped = play(false);
            let smooth = play(true);
            let contact_n = stepped.largest_contact_step_n();
            let contact_smooth_n = smooth.largest_contact_step_n();
            let felt_n = stepped.largest_felt_step_n();
            let felt_smooth_n = smooth.largest_felt_step_n();
            eprintln!(
                "{coupling:?}, {update_hz} Hz: contact {contact_n:.3} N -> {contact_smooth_n:.3} \
                    N, felt {felt_n:.3} N -> {felt_smooth_n:.3} N"
            );
            assert!(contact_smooth_n < most_share * contact_n, "{coupling:?}, {update_hz} Hz");
            assert!(felt_smooth_n < felt_n, "{coupling:?}, {update_hz} Hz");
            if coupling == CouplingMode::Direct {
                let expected_n = 50.0 / update_hz - 0.05;
                assert!(
                    (contact_n / expected_n - 1.0).abs() < 0.1,
                    "{contact_n} N, expected {expected_n} N"
                );
            }
        }
    }
}
