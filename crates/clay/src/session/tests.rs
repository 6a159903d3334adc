use super::*;
use crate::falloff::Falloff;
use crate::material_map::{MaterialPlace, Painted};
use crate::paint::Brush;
use crate::pull::PullForce;
use crate::shapes::sphere;
use vps::storage::sections::reseal;

const R: f64 = 0.02;

/// A clay model with two strokes, one of them taken back.
fn model() -> ClayModel {
    let mut model = model_of(Material::default());
    for _ in 0..2 {
        for _ in 0..10 {
            let along_map = vec![DVec3::Z * R];
            let force_n = DVec3::Z * 5.0;
            model
                .pull(&PullForce {
                    along_map,
                    force_n,
                    reach_m: 4e-3,
                    radius_m: 6e-3,
                    falloff: Falloff::Gaussian,
                })
                .unwrap();
            model.advance(4e-3);
        }
        model.end_stroke().unwrap();
    }
    assert!(model.undo().unwrap());
    model
}

/// A clay model without strokes.
fn model_of(material: Material) -> ClayModel {
    let settings = Settings {
        material,
        region_map: Some((DVec3::new(-0.01, -0.01, 0.01), DVec3::new(0.01, 0.01, 0.03))),
        raster: [9, 10, 11],
        integrator: Integrator::Explicit,
        ..Settings::default()
    };
    ClayModel::new(sphere(300, R), settings).unwrap()
}

fn saved(model: &ClayModel) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clay.session");
    model.save_session(&path).unwrap();
    std::fs::read(&path).unwrap()
}

fn loaded(bytes: &[u8]) -> Result<ClayModel, SessionFileError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clay.session");
    std::fs::write(&path, bytes).unwrap();
    ClayModel::load_session(&path)
}

#[test]
fn a_field_that_interpolates_is_one_again() {
    let settings = Settings { interpolates: true, raster: [9; 3], ..Settings::default() };
    let model = ClayModel::new(sphere(300, R), settings).unwrap();
    let after = loaded(&saved(&model)).unwrap();
    assert_eq!(after.settings(), model.settings());
    for at in after.points().positions_map.iter().step_by(10) {
        assert!(after.surface().at(*at).value_m.abs() < 1e-12, "{at}");
    }
    assert!(!loaded(&saved(&model_of(Material::default()))).unwrap().settings().interpolates);
}

#[test]
fn a_material_that_was_laid_everywhere_is_kept_with_what_it_was_before() {
    let mut model = model_of(Material::default());
    let hard = Painted { stiffness_n_per_m: Some(777.0), ..Painted::default() };
    model.lay_material(hard, &MaterialPlace::Everywhere).unwrap();
    let mut after = loaded(&saved(&model)).unwrap();
    assert_eq!((after.settings().material.stiffness_n_per_m, after.history()), (777.0, (1, 0)));
    assert!(after.undo().unwrap());
    assert_eq!(after.settings().material, Material::default());
    assert!(after.redo().unwrap());
    assert_eq!(after.settings().material.stiffness_n_per_m, 777.0);
}

#[test]
fn a_session_goes_on_where_it_was_left() {
    let mut before = model();
    let bytes = saved(&before);
    let mut after = loaded(&bytes).unwrap();
    assert!(saved(&after) == bytes, "saved again it has the same bytes");
    assert_eq!(
        (after.points(), after.base(), after.history()),
        (before.points(), before.base(), (1, 1))
    );
    assert_eq!(after.region_map(), before.region_map());
    assert_eq!(
        (&after.settings().material, after.settings().integrator),
        (&before.settings().material, Integrator::Explicit)
    );
    // Back to the begin, forward to the end, and on.
    assert!(before.redo().unwrap() && after.redo().unwrap());
    assert_eq!((after.points(), after.base()), (before.points(), before.base()));
    assert!(after.undo().unwrap() && after.undo().unwrap() && !after.undo().unwrap());
    assert_eq!(*after.points(), sphere(300, R));
    after.begin_stroke().unwrap();
    after.advance(4e-3);
    after.end_stroke().unwrap();
}

#[test]
fn whatever_material_a_scene_may_have_is_read_again() {
    let material = Material {
        mass_kg: 3e-5,
        damping_n_s_per_m: 0.0,
        stiffness_n_per_m: 123.0,
        creep_s: f64::INFINITY,
        acceleration_max_m_per_s2: 77.0,
    };
    assert_eq!(loaded(&saved(&model_of(material.clone()))).unwrap().settings().material, material);
    for wrong in [
        Material { mass_kg: 0.0, ..material.clone() },
        Material { stiffness_n_per_m: -1.0, ..material },
    ] {
        assert!(matches!(loaded(&saved(&model_of(wrong))), Err(SessionFileError::Refused { .. })));
    }
}

#[test]
fn painted_material_is_kept_with_its_past_and_shared_as_before() {
    let brush = Brush {
        color: [9, 9, 9],
        radius_m_per_n: 4e-3,
        radius_max_m: 8e-3,
        falloff: Falloff::Constant,
        smallest_m: 1e-3,
    };
    let mut before = model();
    let stiff = Painted { stiffness_n_per_m: Some(700.0), ..Painted::default() };
    let heavy = Painted { mass_kg: Some(2e-4), damping_n_s_per_m: Some(0.0), ..Painted::default() };
    for painted in [stiff, heavy] {
        assert!(before.paint_material(&brush, painted, DVec3::Z * R, 2.0).unwrap() > 0);
        before.end_stroke().unwrap();
    }
    let bytes = saved(&before);
    let mut after = loaded(&bytes).unwrap();
    assert!(saved(&after) == bytes, "saved again it has the same bytes");
    assert!(after.material_map().is_same(before.material_map()) && !after.material_map().is_bare());
    let [now, heavy_before] = [after.moment(), after.moments().0.last().unwrap().clone()];
    let stiffness = |moment: &Snapshot| moment.material_map.layers()[2].clone().unwrap();
    assert!(Arc::ptr_eq(&stiffness(&now), &stiffness(&heavy_before)), "one stiffness for both");
    while before.undo().unwrap() {
        assert!(after.undo().unwrap());
        assert!(after.material_map().is_same(before.material_map()));
        assert_eq!(after.points(), before.points());
    }
    assert!(!after.undo().unwrap() && after.material_map().is_bare());
    while before.redo().unwrap() {
        assert!(after.redo().unwrap());
        assert!(after.material_map().is_same(before.material_map()));
    }
    // Neither values that are missing nor such as nothing is made of.
    for (from, to) in [(700.0_f32, f32::INFINITY), (2e-4, -1.0)] {
        let mut forged = bytes.clone();
        let at = forged.chunks_exact(4).position(|word| word == from.to_le_bytes()).unwrap() * 4;
        forged[at..at + 4].copy_from_slice(&to.to_le_bytes());
        reseal(&mut forged);
        assert!(matches!(loaded(&forged), Err(SessionFileError::Refused { .. })), "{from}");
    }
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn what_is_damaged_anywhere_is_refused_or_the_same_model() {
    let bytes = saved(&model());
    let mut n_harmless = 0;
    // Every third byte of head and table, and some of every array.
    for at in (0..1024).step_by(3).chain((1024..bytes.len()).step_by(1021)) {
        let mut damaged = bytes.clone();
        damaged[at] ^= 0x20;
        match loaded(&damaged) {
            Err(SessionFileError::Refused { .. }) => {}
            // Between two arrays nothing is read.
            Ok(same) => {
                n_harmless += 1;
                assert!(saved(&same) == bytes, "byte {at}");
            }
            Err(error) => panic!("byte {at}: {error}"),
        }
    }
    assert!(n_harmless < 200, "{n_harmless}");
    for n in [0, 1, 63, 64, 400, bytes.len() / 2, bytes.len() - 1] {
        assert!(
            matches!(loaded(&bytes[..n]), Err(SessionFileError::Refused { .. })),
            "cut off behind {n} bytes"
        );
    }
    assert!(matches!(
        loaded(b"no session at all, but long enough to be looked at; really, it has more than 64 bytes"),
        Err(SessionFileError::Refused { .. })
    ));
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn what_was_changed_with_its_checksums_makes_no_model_but_no_panic_either() {
    let bytes = saved(&model());
    let mut n_refused = 0;
    let mut n = 0;
    for at in (64..2048.min(bytes.len())).step_by(16).chain((2048..bytes.len()).step_by(16_411)) {
        for value in [0_u8, 0x7f, 0xff] {
            let mut forged = bytes.clone();
            forged[at..(at + 8).min(bytes.len())].fill(value);
            reseal(&mut forged);
            n += 1;
            n_refused += usize::from(loaded(&forged).is_err());
        }
    }
    assert!(n_refused > n / 10, "{n_refused} of {n}");
}

#[test]
fn a_file_of_another_version_says_so() {
    let mut bytes = saved(&model());
    let at = vps::storage::sections::VERSIONS_AT.end - 4;
    bytes[at] += 1;
    reseal(&mut bytes);
    let error = loaded(&bytes).unwrap_err().to_string();
    assert!(error.contains("newer version") && error.contains("clay.session"), "{error}");
    let error = ClayModel::load_session(Path::new("/no/such/session")).unwrap_err().to_string();
    assert!(error.starts_with("cannot read /no/such/session"), "{error}");
}

#[test]
fn the_past_that_is_kept_is_the_nearest() {
    let model = model();
    let moment = model.moment();
    let many = vec![moment.clone(); 4];
    let (moments, n_past) = kept(&moment, &many, &many);
    assert_eq!((moments.len(), n_past), (9, 4));
    let mut points = moment.samples.points().clone();
    points.positions_map.resize(MOMENTS_BYTES_MAX / 48, DVec3::ZERO);
    let large =
        Snapshot::new(points, (*moment.base).clone(), MaterialMap::default(), moment.region, None)
            .unwrap();
    let past = [moment.clone(), large, moment.clone(), moment.clone()];
    let (moments, n_past) = kept(&moment, &past, &[]);
    assert_eq!((moments.len(), n_past), (3, 2));
}
