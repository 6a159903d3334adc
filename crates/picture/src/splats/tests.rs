use super::*;

/// Even samples of a ball; red on the side of +x.
fn ball(n: usize, radius_m: f64, middle_map: DVec3) -> PointSet {
    let mut points = PointSet::default();
    for k in 0..n {
        let z = 1.0 - (2.0 * k as f64 + 1.0) / n as f64;
        let (sin, cos) = (k as f64 * 2.399_963_229_728_653).sin_cos();
        let across = (1.0 - z * z).sqrt();
        let normal = DVec3::new(across * cos, across * sin, z).normalize();
        points.push(
            middle_map + normal * radius_m,
            normal,
            if normal.x > 0.0 { [200, 60, 40] } else { [190; 3] },
        );
    }
    points
}

fn subject<'a>(points: &'a PointSet, beside: Option<&'a PointSet>) -> ClaySnapshot<'a> {
    as_form(points, beside, SampleForm::Surface)
}

fn as_form<'a>(
    points: &'a PointSet,
    beside: Option<&'a PointSet>,
    form: SampleForm,
) -> ClaySnapshot<'a> {
    static NONE: MassPoints = MassPoints { places_map: Vec::new(), spacing_m: 0.0 };
    ClaySnapshot { name: "ball", points, beside, form, mass_points: &NONE }
}

fn decoded(subjects: &[ClaySnapshot<'_>]) -> tiny_skia::Pixmap {
    tiny_skia::Pixmap::decode_png(&png(subjects).unwrap()).unwrap()
}

/// Width and height of what is not backdrop in one view, pixels; words and bars lie outside of the
/// middle that is looked at.
fn extent(sheet: &tiny_skia::Pixmap, [left, top]: [i32; 2], [width, height]: [i32; 2]) -> [i32; 2] {
    let is_clay = |x: i32, y: i32| {
        let pixel = sheet.pixel((left + x) as u32, (top + HEADER + y) as u32).unwrap();
        [pixel.red(), pixel.green(), pixel.blue()] != BACKDROP
    };
    let wide = (0..width).filter(|x| is_clay(*x, height / 2)).count();
    let tall = (0..height).filter(|y| is_clay(width / 2, *y)).count();
    [wide as i32, tall as i32]
}

#[test]
fn a_ball_is_round_from_every_side_and_without_holes() {
    let points = ball(3000, 0.02, DVec3::new(0.1, -0.2, 0.05));
    let sheet = decoded(&[subject(&points, None)]);
    assert_eq!([sheet.width(), sheet.height()], [1000, 484]);
    for (_, corner, size, _) in VIEWS {
        let [wide, tall] = extent(&sheet, corner, size);
        let expected = FILLED * f64::from(size[1]);
        assert!((f64::from(wide) / expected - 1.0).abs() < 0.03, "{wide} of {expected} pixels");
        assert!((f64::from(tall) / expected - 1.0).abs() < 0.03, "{tall} of {expected} pixels");
    }
}

#[test]
fn colours_lie_where_they_are_and_light_comes_from_above() {
    let points = ball(3000, 0.02, DVec3::ZERO);
    let sheet = decoded(&[subject(&points, None)]);
    let (_, [left, top], [width, height], _) = VIEWS[1];
    let color = |u: f64, v: f64| {
        let at =
            [left + (u * f64::from(width)) as i32, top + HEADER + (v * f64::from(height)) as i32];
        let pixel = sheet.pixel(at[0] as u32, at[1] as u32).unwrap();
        [pixel.red(), pixel.green(), pixel.blue()].map(i32::from)
    };
    let [red, green, _] = color(0.6, 0.5);
    assert!(red > green + 60, "red on the side of +x");
    let [red, green, _] = color(0.4, 0.5);
    assert!((red - green).abs() < 8, "grey on the other");
    assert!(color(0.45, 0.2)[1] > color(0.45, 0.8)[1] + 30);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn pieces_that_are_beside_each_other_have_one_scale() {
    let small = ball(2000, 0.01, DVec3::ZERO);
    let large = ball(2000, 0.02, DVec3::ZERO);
    let sheet = decoded(&[subject(&small, Some(&large))]);
    let (_, corner, size, _) = VIEWS[2];
    let [wide, _] = extent(&sheet, corner, size);
    assert!(
        (f64::from(wide) / (0.5 * FILLED * f64::from(size[1])) - 1.0).abs() < 0.04,
        "{wide} pixels"
    );
    assert_eq!(decoded(&[subject(&small, Some(&large)), subject(&large, None)]).height(), 2 * 484);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn the_same_model_gives_the_same_bytes() {
    let points = ball(500, 0.02, DVec3::ZERO);
    let folder = tempfile::tempdir().unwrap();
    let [one, other] = ["one.png", "other.png"].map(|name| folder.path().join(name));
    write(&one, &[subject(&points, None)]).unwrap();
    write(&other, &[subject(&points, None)]).unwrap();
    assert!(std::fs::read(one).unwrap() == std::fs::read(other).unwrap());
}

#[test]
fn nothing_is_an_empty_sheet_and_a_few_samples_are_no_trouble() {
    decoded(&[subject(&PointSet::default(), None)]);
    let points = ball(1, 0.01, DVec3::ZERO);
    decoded(&[subject(&points, None)]);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn samples_are_discs_sprites_or_spheres_too() {
    let points = ball(400, 0.02, DVec3::ZERO);
    let covered = |form| {
        let sheet = decoded(&[as_form(&points, None, form)]);
        let (_, [left, top], [width, height], _) = VIEWS[1];
        // Without the word and the bar at the rim.
        let at = |n: i32| {
            sheet
                .pixel(
                    (left + width / 4 + n % (width / 2)) as u32,
                    (top + HEADER + height / 8 + n / (width / 2)) as u32,
                )
                .unwrap()
        };
        let tones: Vec<_> = (0..width / 2 * (3 * height / 4))
            .map(|n| [at(n).red(), at(n).green(), at(n).blue()])
            .filter(|color| *color != BACKDROP)
            .collect();
        (tones.len() as f64, tones.iter().collect::<std::collections::HashSet<_>>().len())
    };
    let [surface, discs, sprites, spheres] =
        [SampleForm::Surface, SampleForm::Discs, SampleForm::Sprites, SampleForm::Spheres]
            .map(covered);
    assert!(
        discs.0 < 0.9 * surface.0,
        "there are gaps between discs: {discs:?} {surface:?}, sprites {sprites:?}, spheres \
            {spheres:?}"
    );
    assert!(sprites.0 > 1.1 * discs.0, "sprites face the viewer: {sprites:?} {discs:?}");
    assert!(
        (spheres.0 / sprites.0 - 1.0).abs() < 0.01 && spheres.1 > 2 * sprites.1,
        "a sphere is round in the light: {spheres:?} {sprites:?}"
    );
}

#[test]
fn mass_points_beside_the_surface_are_those_within_their_distance() {
    let lattice =
        vps::density::Lattice { origin_map: DVec3::ZERO, spacing_m: 1e-3, dims: [3, 2, 6] };
    let mut region = Raster::uniform(lattice, 0.0);
    // A plane at z = 2.4 mm.
    region
        .values_m_mut()
        .iter_mut()
        .enumerate()
        .for_each(|(n, value_m)| *value_m = 2.4e-3 - (n % 6) as f32 * 1e-3);
    let MassPoints { places_map, spacing_m } = MassPoints::beside_surface(&region);
    assert_eq!((places_map.len(), spacing_m), (2 * 3 * 2, 1e-3));
    assert!(places_map.iter().all(|at| (at.z - 2.4e-3).abs() < 1e-3));
}
