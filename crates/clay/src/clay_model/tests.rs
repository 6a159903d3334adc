use super::super::dynamics::Material;
use super::*;
use crate::falloff::Falloff;
use crate::material_map::Painted;
use crate::paint::{Brush, Dab};
use crate::shapes::sphere;

pub(super) const R: f64 = 0.02;

pub(super) fn settings() -> Settings {
    Settings {
        region_map: Some((DVec3::new(-0.012, -0.012, 0.008), DVec3::new(0.012, 0.012, 0.032))),
        raster: [31; 3],
        air_m: 5e-3,
        material: Material {
            creep_s: 0.05,
            acceleration_max_m_per_s2: f64::INFINITY,
            ..Material::default()
        },
        ..Settings::default()
    }
}

pub(super) fn ball() -> ClayModel {
    ClayModel::new(sphere(4000, R), settings()).unwrap()
}

/// Pulls the pole up, or pushes it down, in 50 updates.
pub(super) fn stroke(model: &mut ClayModel, force_n: f64) {
    for _ in 0..50 {
        let top = model.onto(DVec3::Z * R, 0.01).map_or(DVec3::Z * R, |(at, _)| at);
        model
            .pull(&PullForce {
                along_map: vec![top],
                force_n: DVec3::Z * force_n,
                reach_m: 3e-3,
                radius_m: 5e-3,
                falloff: Falloff::Gaussian,
            })
            .unwrap();
        model.advance(4e-3);
    }
    model.end_stroke().unwrap();
}

fn top_m(model: &ClayModel) -> f64 {
    model.points().positions_map.iter().map(|at| at.z).fold(0.0, f64::max)
}

#[test]
fn acceptance_31_a_stroke_moves_the_surface_its_samples_and_its_fits_together() {
    for force_n in [10.0, -10.0] {
        let mut model = ball();
        stroke(&mut model, force_n);
        let moved = model.onto(DVec3::Z * R, 0.01).unwrap().0.z - R;
        assert!(moved * force_n.signum() > 1e-3, "{force_n} N moved it by {moved} m");
        let samples: Vec<u32> = (0..model.points().len() as u32).collect();
        assert!(resample::largest_gap_m(model.points(), &samples, model.gap_m()) <= model.gap_m());
        for (at, normal) in model.points().positions_map.iter().zip(&model.points().normals_map) {
            let off = model.density_m(*at).unwrap();
            assert!(
                off.abs() < 0.1 * model.region().lattice().spacing_m,
                "{at}: {off} m off in the densities"
            );
            let fitted = model.surface().at(*at).value_m;
            assert!(
                fitted.abs() < 0.2 * model.surface().spacing_m(),
                "{at}: {fitted} m off in the fits"
            );
            assert!(normal.is_normalized());
        }
        // Far from the stroke nothing has moved.
        let before = sphere(4000, R);
        let far = before.positions_map.iter().filter(|at| at.z < 0.0);
        assert!(far.clone().all(|at| model.points().positions_map.contains(at)));
    }
}

#[test]
fn what_a_force_hardly_reaches_stays_to_the_bit() {
    // All of the ball deforms.
    let mut model =
        ClayModel::new(sphere(4000, R), Settings { region_map: None, ..settings() }).unwrap();
    let points = model.points().clone();
    let base = model.base().clone();
    stroke(&mut model, 10.0);
    assert!(top_m(&model) > R + 1e-3, "{}", top_m(&model));
    let is_below = |at: &DVec3| at.z < -0.5 * R;
    let below = |points: &PointSet| -> Vec<(DVec3, DVec3)> {
        let all = points.positions_map.iter().copied().zip(points.normals_map.iter().copied());
        all.filter(|(at, _)| is_below(at)).collect()
    };
    let mut was = below(&points);
    let mut is = below(model.points());
    let by_place = |one: &(DVec3, DVec3), other: &(DVec3, DVec3)| {
        one.0.x.total_cmp(&other.0.x).then(one.0.y.total_cmp(&other.0.y))
    };
    was.sort_by(by_place);
    is.sort_by(by_place);
    assert!(was.len() > 900 && was == is, "{} samples, {} samples", was.len(), is.len());
    let lattice = base.lattice();
    let [nx, ny, nz] = lattice.dims;
    let nodes = (0..nx).flat_map(|x| (0..ny).flat_map(move |y| (0..nz).map(move |z| [x, y, z])));
    for node in nodes.filter(|node| is_below(&lattice.position(*node))) {
        let at = lattice.index(node);
        assert_eq!(model.base().values_m()[at], base.values_m()[at], "{node:?}");
    }
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn strokes_are_taken_back_and_done_again() {
    let mut model = ball();
    let start = (model.points().clone(), model.base().clone());
    let at = DVec3::new(1e-3, 2e-3, R);
    let fitted = model.surface().at(at);
    stroke(&mut model, 10.0);
    let first = (model.points().clone(), model.base().clone());
    stroke(&mut model, -5.0);
    let second = (model.points().clone(), model.base().clone());
    assert_eq!(model.history(), (2, 0));
    let is = |model: &ClayModel, (points, base): &(PointSet, Arc<Raster>)| {
        model.points() == points && model.base().values_m() == base.values_m()
    };
    assert!(model.undo().unwrap() && is(&model, &first));
    assert!(model.undo().unwrap() && is(&model, &start));
    assert_eq!(model.surface().at(at), fitted, "fits come back to the bit");
    assert!(!model.undo().unwrap());
    assert!(model.redo().unwrap() && is(&model, &first));
    assert!(model.redo().unwrap() && is(&model, &second));
    assert!(!model.redo().unwrap());
    model.undo().unwrap();
    stroke(&mut model, 3.0);
    assert_eq!(model.history(), (2, 0), "a new stroke leaves nothing to be done again");
}

#[test]
fn what_can_be_taken_back_is_bounded_by_memory_too() {
    let mut model = ball();
    let before = model.moment();
    stroke(&mut model, 3.0);
    let after = model.moment();
    let left = |mut past: Vec<Snapshot>, bytes_max: usize| {
        undo_history::forget(&mut past, bytes_max);
        past.len()
    };
    let n_bytes = before.n_bytes(Some(&after)) + after.n_bytes(None);
    assert_eq!(left(vec![before.clone(), after.clone()], n_bytes), 2);
    assert_eq!(left(vec![before.clone(), after.clone()], n_bytes - 1), 1);
    assert_eq!(
        left(vec![before.clone(), after.clone()], 0),
        1,
        "the last stroke can be taken back whatever it takes"
    );
    // Material that was painted once is counted once.
    let mut painted = after.clone();
    let mut coat = MaterialCoat::over(
        &after.material_map,
        after.base.lattice().n_nodes(),
        Painted { mass_kg: Some(1.0), ..Painted::default() },
    );
    let dab = Dab { at_map: DVec3::ZERO, normal_map: DVec3::Z, radius_m: R };
    coat.dab(
        &mut painted.material_map,
        (after.base.lattice(), &Material::default()),
        &Falloff::Constant,
        dab,
    );
    let material_bytes = 4 * after.base.lattice().n_nodes();
    assert_eq!(painted.n_bytes(None), after.n_bytes(None) + material_bytes);
    assert_eq!(painted.n_bytes_in_session(), after.n_bytes_in_session() + material_bytes);
    let three = painted.n_bytes(None) + 2 * painted.n_bytes(Some(&painted));
    assert_eq!(left(vec![painted.clone(); 3], three), 3);
    assert_eq!(left(vec![painted; 3], three - 1), 2);
    // Strokes of paint have one raster between them.
    let painted = vec![before.clone(); 3];
    assert_eq!(left(painted.clone(), before.n_bytes(None) + 2 * before.n_bytes(Some(&before))), 3);
    assert_eq!(left(painted, before.n_bytes(None) + 2 * before.n_bytes(Some(&before)) - 1), 2);
    assert_eq!(left(vec![before; 65], usize::MAX), 64);
    assert_eq!(left(Vec::new(), 0), 0);
}

#[test]
fn the_same_strokes_give_the_same_bits_on_any_number_of_threads() {
    let on = |threads: usize| {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
            let mut model = ball();
            stroke(&mut model, 10.0);
            (model.points().clone(), model.base().values_m().to_vec())
        })
    };
    assert!(on(1) == on(4));
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_bite_is_taken_out_and_an_image_stands_out() {
    let mut model = ball();
    let bite = PointSurface::build(
        {
            let mut points = sphere(2000, 0.01);
            points.positions_map.iter_mut().for_each(|at| *at += DVec3::X * R);
            points
        },
        PointSurface::DEFAULT_NEIGHBOURS,
    )
    .unwrap();
    for is_sharp in [false, true] {
        model.combine(Boolean::Difference, &bite, is_sharp).unwrap();
        let middle = model.base().at(DVec3::X * 0.015).unwrap().value_m;
        assert!(middle < -3e-3, "{middle} m where the bite was");
        let left = model.base().at(-DVec3::X * 0.015).unwrap().value_m;
        assert!(left > 3e-3, "{left} m where nothing was taken");
        assert!(model.undo().unwrap());
    }
    let white = GreyImage::new(2, 2, vec![1.0; 4]).unwrap();
    let placement = ImagePlacement::Around {
        center_map: DVec3::ZERO,
        north_map: DVec3::Z,
        front_map: DVec3::X,
    };
    assert_eq!(model.emboss(&white, &placement, 1e-3).unwrap(), 4000);
    assert!((top_m(&model) - (R + 1e-3)).abs() < 1e-4, "{}", top_m(&model));
}

#[test]
fn a_relief_that_is_higher_than_the_air_around_the_clay_gets_a_larger_raster_until_it_is_undone() {
    let mut model = ball();
    let white = GreyImage::new(2, 2, vec![1.0; 4]).unwrap();
    let placement = ImagePlacement::Around {
        center_map: DVec3::ZERO,
        north_map: DVec3::Z,
        front_map: DVec3::X,
    };
    let lattice = *model.base().lattice();
    let most_m = lattice.bounds().1.max_element();
    let mut raised_m = 0.0;
    while R + raised_m < most_m + 3e-3 {
        model.emboss(&white, &placement, 3e-3).unwrap();
        raised_m += 3e-3;
    }
    for way in [DVec3::X, -DVec3::Y, DVec3::Z] {
        let density_m = |away_m: f64| {
            model.base().at(way * (R + raised_m + away_m)).map(|density| density.value_m)
        };
        assert!(
            density_m(-2e-3).unwrap() > 0.5e-3 && density_m(2e-3).unwrap() < -0.5e-3,
            "{way}: {:?} {:?}",
            density_m(-2e-3),
            density_m(2e-3)
        );
    }
    while model.undo().unwrap() {}
    assert_eq!(*model.base().lattice(), lattice);
}

#[test]
fn a_frame_shows_the_region_as_it_is() {
    let mut model = ball();
    let lattice = Lattice { origin_map: DVec3::ZERO, spacing_m: 1.0, dims: [2; 3] };
    let nothing = Raster::uniform(lattice, 0.0);
    let mut frame = DensityFrame {
        sequence: 0,
        base: Arc::new(nothing.clone()),
        region: nothing,
        rope_map: None,
        is_leap: false,
    };
    for sequence in 1..4 {
        model.advance(4e-3);
        model.show(&mut frame);
        assert_eq!(
            (frame.sequence, frame.region.values_m()),
            (sequence, model.region().values_m())
        );
        assert!(Arc::ptr_eq(&frame.base, model.base()));
        // Nodes of the region are nodes of the base, with its densities where nothing moves.
        let corner = frame.region.lattice().position([0, 0, 0]);
        assert_eq!(
            frame.region.at(corner).unwrap().value_m,
            frame.base.at(corner).unwrap().value_m
        );
    }
}

#[test]
fn what_cannot_be_worked_is_refused() {
    let refused = |change: fn(&mut Settings)| {
        let mut settings = settings();
        change(&mut settings);
        ClayModel::new(sphere(500, R), settings).map(drop).unwrap_err()
    };
    assert!(matches!(refused(|settings| settings.raster = [3, 10, 10]), ClayModelError::Raster(_)));
    assert!(matches!(
        refused(|settings| settings.region_map = Some((DVec3::ONE, DVec3::ZERO))),
        ClayModelError::Region(..)
    ));
    assert!(matches!(
        refused(|settings| settings.region_map = Some((DVec3::NAN, DVec3::ZERO))),
        ClayModelError::Region(..)
    ));
    let fine = refused(|settings| settings.region_map = Some((DVec3::ZERO, DVec3::splat(1e-4))));
    assert!(matches!(fine, ClayModelError::TooFine { .. }), "{fine}");
    let few = ClayModel::new(sphere(3, R), settings()).map(drop).unwrap_err();
    assert!(matches!(few, ClayModelError::Surface(SurfaceError::TooFew { found: 3 })), "{few}");
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn edges_and_relief_far_from_a_boolean_or_an_image_stay_as_they_are() {
    let bite =
        |at: DVec3| PointSurface::build(shapes_at(at), PointSurface::DEFAULT_NEIGHBOURS).unwrap();
    for region_map in [None, settings().region_map] {
        let mut model =
            ClayModel::new(sphere(4000, R), Settings { region_map, ..settings() }).unwrap();
        model.combine(Boolean::Difference, &bite(DVec3::X * R), true).unwrap();
        let base = model.base().clone();
        let lattice = *base.lattice();
        // Nodes at the first bite, in its edge among others.
        let [nx, ny, nz] = lattice.dims;
        let nodes =
            (0..nx).flat_map(|x| (0..ny).flat_map(move |y| (0..nz).map(move |z| [x, y, z])));
        let there: Vec<DVec3> = nodes
            .map(|node| lattice.position(node))
            .filter(|at| at.x > 0.5 * R && at.length() < 1.2 * R)
            .collect();
        assert!(there.len() > 500, "{}", there.len());
        let is_as_before = |model: &ClayModel, what: &str| {
            for at in &there {
                let [was_m, is_m] =
                    [&base, model.base()].map(|base| f64::from(base.at(*at).unwrap().value_m));
                assert!(
                    (was_m - is_m).abs() < 1e-3 * lattice.spacing_m,
                    "{what}, {region_map:?}: {was_m} became {is_m} m at {at}"
                );
            }
        };
        model.combine(Boolean::Difference, &bite(DVec3::X * -R), true).unwrap();
        is_as_before(&model, "a sharp bite");
        model.combine(Boolean::Difference, &bite(DVec3::new(-0.4, -1.0, 0.0) * R), false).unwrap();
        is_as_before(&model, "a blended bite");
        let image = GreyImage::new(4, 4, vec![1.0; 16]).unwrap();
        let placement = ImagePlacement::Flat {
            middle_map: DVec3::new(-0.3 * R, 0.0, 0.95 * R),
            right_map: DVec3::X * 3e-3,
            up_map: DVec3::Y * 3e-3,
        };
        assert!(model.emboss(&image, &placement, 1e-3).unwrap() > 10);
        is_as_before(&model, "an image");
    }
}

/// Samples of a small ball somewhere.
fn shapes_at(middle_map: DVec3) -> PointSet {
    let mut points = sphere(1000, 0.4 * R);
    points.positions_map.iter_mut().for_each(|at| *at += middle_map);
    points
}

#[test]
fn a_stroke_that_moves_nothing_is_none_and_leaves_what_can_be_done_again() {
    let mut model = ball();
    stroke(&mut model, 10.0);
    model.undo().unwrap();
    assert_eq!(model.history(), (0, 1));
    let before = (model.points().clone(), model.base().clone(), model.strokes());
    stroke(&mut model, 1e-4);
    assert_eq!(model.history(), (0, 1));
    assert!(
        *model.points() == before.0 && **model.base() == *before.1 && model.strokes() == before.2
    );
    assert!(
        model
            .region()
            .values_m()
            .iter()
            .zip(cut_out(&model).values_m())
            .all(|(now, rest)| now == rest)
    );
    assert!(model.redo().unwrap());
    assert!(top_m(&model) > R + 1e-3);
}

fn cut_out(model: &ClayModel) -> Raster {
    cut(
        model.base(),
        lattices::first_node(model.base().lattice(), model.region().lattice()),
        *model.region().lattice(),
    )
}

#[test]
fn a_brush_that_covers_no_sample_makes_no_stroke() {
    let mut model = ball();
    let brush = |radius_max_m| Brush {
        color: [255, 0, 0],
        radius_m_per_n: 1e-3,
        radius_max_m,
        falloff: Falloff::Gaussian,
        smallest_m: model.smallest_disc_m(),
    };
    let faint = brush(1e-9);
    let broad = brush(5e-3);
    assert_eq!(model.paint(&faint, DVec3::new(1e-4, 2e-4, R), 1.0).unwrap(), 0);
    assert!(!model.is_stroke());
    assert_eq!((model.history(), model.strokes()), ((0, 0), 0));
    assert!(model.paint(&broad, DVec3::Z * R, 3.0).unwrap() > 10);
    assert!(model.is_stroke());
    model.end_stroke().unwrap();
    assert_eq!((model.history(), model.strokes()), ((1, 0), 1));
}

#[test]
fn a_rim_is_split_where_the_brush_has_passed_while_it_is_down() {
    let mut model = ball();
    let brush = Brush {
        color: [255, 0, 0],
        radius_m_per_n: 1e-3,
        radius_max_m: 2e-3,
        falloff: Falloff::Constant,
        smallest_m: model.smallest_disc_m(),
    };
    let on_way = |k: u32| {
        let (sin, cos) = (f64::from(k) * 0.01 - 0.5).sin_cos();
        DVec3::new(sin, 0.0, cos) * R
    };
    for k in 0..100 {
        model.paint(&brush, on_way(k), 10.0).unwrap();
    }
    assert!(model.is_stroke());
    let n_near = |model: &ClayModel, at: DVec3| {
        model.points().positions_map.iter().filter(|place| place.distance(at) < 3e-3).count()
    };
    let n_behind = n_near(&model, on_way(5));
    let n_at_work = n_near(&model, on_way(99));
    assert!(n_behind > 2 * n_at_work, "{n_behind} samples behind, {n_at_work} at work");
    let way_m = |at: &DVec3| (0..100).map(|k| at.distance(on_way(k))).fold(f64::INFINITY, f64::min);
    model.end_stroke().unwrap();
    assert!(
        n_near(&model, on_way(99)) > 2 * n_at_work,
        "the rest is split when the brush is lifted"
    );
    // Red is what the brush passed, and nothing else, with finer samples at its rim than anywhere.
    for (at, color) in model.points().positions_map.iter().zip(&model.points().colors) {
        assert!(
            (way_m(at) < 2e-3) == (*color == [255, 0, 0]) || (way_m(at) - 2e-3).abs() < 1e-5,
            "{at}: {color:?}"
        );
    }
    assert_eq!(model.history(), (1, 0));
    assert!(model.undo().unwrap() && model.points().len() == ball().points().len());
}

#[test]
fn a_painted_rim_stays_fine_when_the_surface_beside_it_is_worked() {
    let mut model = ball();
    let brush = Brush {
        color: [255, 0, 0],
        radius_m_per_n: 1e-3,
        radius_max_m: 4e-3,
        falloff: Falloff::Constant,
        smallest_m: model.smallest_disc_m(),
    };
    let aside = DVec3::new(0.45, 0.0, (1.0_f64 - 0.45 * 0.45).sqrt()) * R;
    model.paint(&brush, aside, 10.0).unwrap();
    model.end_stroke().unwrap();
    let n_rim = |model: &ClayModel| {
        model.points().positions_map.iter().filter(|at| at.distance(aside) < 6e-3).count()
    };
    let painted = n_rim(&model);
    assert!(painted > 2 * n_rim(&ball()), "{painted} of {}", n_rim(&ball()));
    stroke(&mut model, -6.0);
    assert!(n_rim(&model) as f64 > 0.9 * painted as f64, "{} of {painted}", n_rim(&model));
}

/// The largest distance of a place of the surface from the nearest sample, m: the radius of the
/// largest empty circle, by the corners of the closed mesh, which lie densely on the densities.
/// Places near the edge of the region, where the raster of the base ends, count as well.
fn largest_empty_circle_m(model: &ClayModel) -> f64 {
    let near = crate::Neighbours::new(&model.points().positions_map);
    let corners = model.mesh().unwrap().vertices;
    corners
        .iter()
        .map(|at| near.nearest(*at).unwrap().distance_squared_m2.sqrt())
        .fold(0.0, f64::max)
}

#[test]
fn no_tool_leaves_an_empty_circle_larger_than_the_threshold() {
    let brush = |model: &ClayModel| Brush {
        color: [255, 0, 0],
        radius_m_per_n: 1e-3,
        radius_max_m: 4e-3,
        falloff: Falloff::Constant,
        smallest_m: model.smallest_disc_m(),
    };
    let white = |model: &mut ClayModel, depth_m: f64| {
        let image = GreyImage::new(2, 2, vec![1.0; 4]).unwrap();
        let placement = ImagePlacement::Flat {
            middle_map: DVec3::Z * R,
            right_map: DVec3::X * 4e-3,
            up_map: DVec3::Y * 4e-3,
        };
        assert!(model.emboss(&image, &placement, depth_m).unwrap() > 30);
    };
    let ball_at = |middle_map: DVec3| {
        PointSurface::build(shapes_at(middle_map), PointSurface::DEFAULT_NEIGHBOURS).unwrap()
    };
    let join = |model: &mut ClayModel, boolean: Boolean, is_sharp: bool| {
        model.combine(boolean, &ball_at(DVec3::new(2e-3, 3e-3, 1.05 * R)), is_sharp).unwrap();
    };
    type Tool<'t> = (&'t str, &'t dyn Fn(&mut ClayModel));
    let tools: [Tool; 11] = [
        ("pull", &|model| stroke(model, 14.0)),
        ("push", &|model| stroke(model, -14.0)),
        ("paint", &|model| {
            model.paint(&brush(model), DVec3::Z * R, 10.0).unwrap();
            model.end_stroke().unwrap();
        }),
        ("emboss", &|model| white(model, 4e-3)),
        ("engrave", &|model| white(model, -4e-3)),
        ("union", &|model| join(model, Boolean::Union, false)),
        ("sharp union", &|model| join(model, Boolean::Union, true)),
        ("difference", &|model| join(model, Boolean::Difference, false)),
        ("sharp difference", &|model| join(model, Boolean::Difference, true)),
        ("sharp intersection", &|model| join(model, Boolean::Intersection, true)),
        ("region", &|model| {
            model
                .choose_region(DVec3::new(-8e-3, -8e-3, 0.012), DVec3::new(8e-3, 8e-3, 0.028))
                .unwrap()
        }),
    ];
    for (name, work) in tools {
        let mut model = ball();
        let before_m = largest_empty_circle_m(&model);
        work(&mut model);
        let after_m = largest_empty_circle_m(&model);
        let gap_m = model.gap_m();
        assert!(
            after_m <= gap_m,
            "{name}: a circle of {after_m} m is empty, before {before_m} m, threshold {gap_m} m"
        );
    }
}

/// V − E + F of the closed mesh: 2 for a ball, 0 for a ring, 4 for two balls.
fn euler_number(model: &ClayModel) -> i64 {
    let mesh = model.mesh().unwrap();
    let mut edges = std::collections::HashSet::new();
    for [a, b, c] in &mesh.triangles {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            edges.insert((from.min(to), from.max(to)));
        }
    }
    let used: std::collections::HashSet<&u32> = mesh.triangles.iter().flatten().collect();
    used.len() as i64 - edges.len() as i64 + mesh.triangles.len() as i64
}

/// Every sample lies on the surface, none in the air or in the material, and the surface has
/// samples everywhere.
fn assert_samples_are_on_the_surface(model: &ClayModel) {
    let spacing_m = model.base().lattice().spacing_m;
    for at in &model.points().positions_map {
        let off_m = model.density_m(*at).unwrap();
        assert!(off_m.abs() < 0.75 * spacing_m, "{at}: {off_m} m off");
    }
    let empty_m = largest_empty_circle_m(model);
    let gap_m = model.gap_m();
    // Corners of the mesh lie beside the samples' levels where the raster rounds an edge.
    assert!(
        empty_m <= gap_m + 0.1 * spacing_m,
        "a circle of {empty_m} m is empty, threshold {gap_m} m"
    );
}

/// Presses or pulls at one place along one direction until the surface is gone there, or for so
/// many updates.
fn work_at(model: &mut ClayModel, at_map: DVec3, force_n: DVec3, updates: u32) {
    for _ in 0..updates {
        let along_map = vec![model.onto(at_map, 4e-3).map_or(at_map, |(at, _)| at)];
        model
            .pull(&PullForce {
                along_map,
                force_n,
                reach_m: 3e-3,
                radius_m: 4e-3,
                falloff: Falloff::Gaussian,
            })
            .unwrap();
        model.advance(4e-3);
    }
    model.end_stroke().unwrap();
}

fn sampled(shape: &vps::mesh::primitives::Shape, spacing_m: f64) -> PointSet {
    crate::sample(&shape.tessellate(0.02 * spacing_m), spacing_m).unwrap()
}

#[test]
fn a_tool_that_is_pushed_through_a_plate_leaves_a_hole() {
    let plate = vps::mesh::primitives::Shape::Box { size_m: DVec3::new(0.024, 0.024, 4e-3) };
    let mut model = ClayModel::new(
        sampled(&plate, 8e-4),
        Settings { region_map: None, raster: [44, 44, 22], air_m: 4e-3, ..settings() },
    )
    .unwrap();
    assert_eq!(euler_number(&model), 2);
    // A tip goes down with 8 N until nothing is left below it.
    let mut at_map = DVec3::Z * 2e-3;
    for _ in 0..60 {
        let Some(there) = model.onto_along(at_map, DVec3::Z, 1.5e-3) else { break };
        at_map = there;
        let along_map = vec![at_map];
        model
            .pull(&PullForce {
                along_map,
                force_n: -DVec3::Z * 8.0,
                reach_m: 2.4e-3,
                radius_m: 4e-3,
                falloff: Falloff::Gaussian,
            })
            .unwrap();
        model.advance(4e-3);
    }
    model.end_stroke().unwrap();
    assert!(model.density_m(DVec3::ZERO).unwrap() < -1e-4);
    assert_eq!(euler_number(&model), 0, "a plate with a hole is a ring");
    assert_eq!((model.take_reconnected(), model.take_reconnected()), (Some((1, 0)), None));
    assert_samples_are_on_the_surface(&model);
    assert!(model.undo().unwrap() && euler_number(&model) == 2);
}

#[test]
fn two_fronts_that_meet_become_one() {
    // Two balls 3 mm apart, one pulled over to the other.
    let mut points = sphere(1500, 8e-3);
    points.positions_map.iter_mut().for_each(|at| at.x -= 9.5e-3);
    let mut other = sphere(1500, 8e-3);
    other.positions_map.iter_mut().for_each(|at| at.x += 9.5e-3);
    points.append(&other);
    let mut model = ClayModel::new(
        points,
        Settings { region_map: None, raster: [60, 34, 34], air_m: 4e-3, ..settings() },
    )
    .unwrap();
    assert_eq!(euler_number(&model), 4);
    work_at(&mut model, DVec3::X * -1.5e-3, DVec3::X * 12.0, 90);
    assert_eq!(euler_number(&model), 2, "two balls that have grown together are one");
    assert_eq!(model.take_reconnected(), Some((2, 1)));
    assert_samples_are_on_the_surface(&model);
}

#[test]
fn a_neck_that_is_pulled_thin_breaks() {
    // A dumb-bell: two balls and a bar of 2.4 mm between them, pulled from all sides until nothing
    // is left of its middle.
    let ball = |x: f64| {
        let mut points = sphere(1500, 8e-3);
        points.positions_map.iter_mut().for_each(|at| at.x += x);
        points
    };
    let mut model = ClayModel::new(
        ball(-0.011),
        Settings { region_map: None, raster: [66, 34, 34], air_m: 4e-3, ..settings() },
    )
    .unwrap();
    let bar = vps::mesh::primitives::Shape::Cylinder { radius_m: 1.6e-3, height_m: 0.012 };
    let mut bar = sampled(&bar, 5e-4);
    for (at, normal) in bar.positions_map.iter_mut().zip(&mut bar.normals_map) {
        (*at, *normal) = (DVec3::new(at.z, at.x, at.y), DVec3::new(normal.z, normal.x, normal.y));
    }
    for solid in [bar, ball(0.011)] {
        model
            .combine(
                Boolean::Union,
                &PointSurface::build(solid, PointSurface::DEFAULT_NEIGHBOURS).unwrap(),
                true,
            )
            .unwrap();
    }
    assert_eq!(euler_number(&model), 2);
    for n in 0..8 {
        let (sin, cos) = (f64::from(n) * core::f64::consts::FRAC_PI_4).sin_cos();
        let out = DVec3::new(0.0, cos, sin);
        assert_eq!(model.take_reconnected(), None, "{n}");
        work_at(&mut model, out * 1.6e-3, out * -8.0, 16);
        if euler_number(&model) == 4 {
            break;
        }
    }
    assert_eq!(euler_number(&model), 4, "a broken dumb-bell is two pieces");
    assert_eq!(model.take_reconnected(), Some((1, 2)));
    assert_samples_are_on_the_surface(&model);
}

/// A ball with a bite: the exact field, whose edge is a circle.
fn bitten_m(at: DVec3) -> f64 {
    (R - at.length()).min(at.distance(BITE_MAP) - 0.4 * R)
}

const BITE_MAP: DVec3 = DVec3::new(0.0, 0.0, R);

/// Places of the bitten ball's surface at a distance from its edge along either face, m; 0: on the
/// edge.
fn beside_edge(away_m: f64) -> Vec<DVec3> {
    // The edge is where both spheres meet.
    let big = R;
    let small = 0.4 * R;
    let z = (2.0 * R * R - small * small) / (2.0 * R);
    let on_big = (z / big).acos() + away_m / big;
    let on_small = ((R - z) / small).acos() - away_m / small;
    let ring = |turn: u32| (f64::from(turn) * core::f64::consts::TAU / 40.0).sin_cos();
    let around = |radius: f64, z: f64| {
        (0..40).map(move |turn| DVec3::new(radius * ring(turn).1, radius * ring(turn).0, z))
    };
    let outer = around(big * on_big.sin(), big * on_big.cos());
    outer.chain(around(small * on_small.sin(), R - small * on_small.cos())).collect()
}

fn bitten(is_sharp: bool) -> ClayModel {
    let mut model = ClayModel::new(
        sphere(6000, R),
        Settings { region_map: None, raster: [56; 3], ..settings() },
    )
    .unwrap();
    let bite = PointSurface::build(shapes_at(BITE_MAP), PointSurface::DEFAULT_NEIGHBOURS).unwrap();
    model.combine(Boolean::Difference, &bite, is_sharp).unwrap();
    model
}

/// The farthest that fits, and densities, are off on the exact surface from the edge to 1.5 mm away
/// from it, m.
fn edge_deviations_m(model: &ClayModel) -> [f64; 2] {
    let places = [0.0, 1e-4, 3e-4, 6e-4, 1e-3, 1.5e-3].map(beside_edge).concat();
    let most =
        |off_m: &dyn Fn(DVec3) -> f64| places.iter().map(|at| off_m(*at).abs()).fold(0.0, f64::max);
    [most(&|at| model.surface().at(at).value_m), most(&|at| model.density_m(at).unwrap())]
}

/// All of the edge, 0.4 mm between mass points; samples are 0.9 mm apart.
const EDGE_REGION: (DVec3, DVec3) =
    (DVec3::new(-0.011, -0.011, 4e-3), DVec3::new(0.011, 0.011, 0.026));

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_sharp_edge_survives_five_strokes_beside_it_and_other_regions() {
    for at in beside_edge(0.0).iter().chain(&beside_edge(1e-3)) {
        assert!(bitten_m(*at).abs() < 1e-9, "{at}");
    }
    let after = |is_sharp: bool| {
        let mut model = bitten(is_sharp);
        let mut deviations_m = Vec::new();
        let measure = |model: &mut ClayModel| {
            model.choose_region(EDGE_REGION.0, EDGE_REGION.1).unwrap();
            edge_deviations_m(model)
        };
        deviations_m.push(measure(&mut model));
        model
            .choose_region(DVec3::new(-0.021, -0.021, -2e-3), DVec3::new(0.021, 0.021, 0.026))
            .unwrap();
        for turn in 0..5 {
            // 6 mm below the edge and farther along it each time.
            let (sin, cos) = (f64::from(turn) * 1.2).sin_cos();
            let beside = DVec3::new(0.647 * cos, 0.647 * sin, 0.763) * R;
            work_at(&mut model, beside, beside.normalize() * 4.0, 12);
        }
        assert_eq!(model.history().0, 6, "five strokes were made after the Boolean");
        deviations_m.push(measure(&mut model));
        deviations_m.concat()
    };
    let sharp_m = after(true);
    let blended_m = after(false);
    // Fits, then densities, which round an edge by a third of the distance between mass points;
    // before the strokes and after them.
    for (off_m, most_m) in sharp_m.iter().zip([0.01e-3, 0.14e-3, 0.1e-3, 0.16e-3]) {
        assert!(*off_m < most_m, "{sharp_m:?} m off");
    }
    assert!(
        blended_m.iter().all(|off_m| *off_m > 0.2e-3),
        "the fits of one patch round the edge by {blended_m:?} m"
    );
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn sharp_edges_stay_through_other_booleans_an_image_and_a_session() {
    let mut model = bitten(true);
    let other =
        |at: DVec3| PointSurface::build(shapes_at(at), PointSurface::DEFAULT_NEIGHBOURS).unwrap();
    // A ball joined sharply below, one smoothly aside, an image at the foot.
    model.combine(Boolean::Union, &other(DVec3::new(0.0, 0.0, -R)), true).unwrap();
    model.combine(Boolean::Union, &other(DVec3::new(R, 0.0, -5e-3)), false).unwrap();
    let image = GreyImage::new(4, 4, vec![1.0; 16]).unwrap();
    let placement = ImagePlacement::Flat {
        middle_map: -DVec3::X * R,
        right_map: DVec3::Y * 3e-3,
        up_map: DVec3::Z * 3e-3,
    };
    assert!(model.emboss(&image, &placement, 1e-3).unwrap() > 10);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("piece.session");
    model.save_session(&path).unwrap();
    let mut again = ClayModel::load_session(&path).unwrap();
    assert!(again.points() == model.points());
    for model in [&mut model, &mut again] {
        model.choose_region(EDGE_REGION.0, EDGE_REGION.1).unwrap();
        let [fits_m, densities_m] = edge_deviations_m(model);
        assert!(fits_m < 0.01e-3 && densities_m < 0.14e-3, "{fits_m} m, {densities_m} m");
    }
    // The valley of the sharp union, where both balls have their own field: 0.4 R around (0, 0, -R)
    // outside of the ball.
    let off_m = beside_edge(0.0)
        .into_iter()
        .map(|at| model.surface().at(-at).value_m.abs())
        .fold(0.0, f64::max);
    assert!(off_m < 0.1e-3, "{off_m} m");
}

#[test]
fn fits_of_two_patches_meet_in_a_sharp_edge_and_those_of_one_round_it() {
    let [sharp_m, blended_m] =
        [true, false].map(|is_sharp| edge_deviations_m(&bitten(is_sharp))[0]);
    assert!(sharp_m < 0.01e-3 && blended_m > 0.2e-3, "{sharp_m} m, {blended_m} m");
}

/// Where lines along x through a grid of (y, z) are inside of a closed mesh: crossings in ascending
/// order, line by line.
fn crossings_m(mesh: &vps::mesh::TriangleMesh, grid: &[(f64, f64)]) -> Vec<Vec<f64>> {
    let mut lines = vec![Vec::new(); grid.len()];
    for triangle in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.corners(triangle);
        let low = a.min(b).min(c);
        let high = a.max(b).max(c);
        let u = b - a;
        let v = c - a;
        let twice = u.y * v.z - u.z * v.y;
        for (line, (y, z)) in lines.iter_mut().zip(grid) {
            if *y < low.y || *y > high.y || *z < low.z || *z > high.z || twice == 0.0 {
                continue;
            }
            let s = ((y - a.y) * v.z - (z - a.z) * v.y) / twice;
            let t = (u.y * (z - a.z) - u.z * (y - a.y)) / twice;
            if s >= 0.0 && t >= 0.0 && s + t <= 1.0 {
                line.push(a.x + u.x * s + v.x * t);
            }
        }
    }
    lines.iter_mut().for_each(|line| line.sort_by(f64::total_cmp));
    lines
}

/// Length of a line where both of two meshes are (or one is) inside, m.
fn length_m(boolean: Boolean, first: &[f64], second: &[f64]) -> f64 {
    let mut ends: Vec<f64> = first.iter().chain(second).copied().collect();
    ends.sort_by(f64::total_cmp);
    let is_in = |crossings: &[f64], x: f64| crossings.iter().filter(|at| **at < x).count() % 2 == 1;
    let pieces = ends.windows(2).filter(|ends| {
        let middle = 0.5 * (ends[0] + ends[1]);
        match (boolean, is_in(first, middle), is_in(second, middle)) {
            (Boolean::Union, first, second) => first || second,
            (Boolean::Intersection, first, second) => first && second,
            (Boolean::Difference, first, second) => first && !second,
        }
    });
    pieces.map(|ends| ends[1] - ends[0]).sum()
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn booleans_of_scans_have_the_volume_of_a_count_along_lines_through_both_meshes() {
    // Real meshes are not part of the repository.
    let Some(folder) = std::env::var_os("HAPTICD_MODELS").map(std::path::PathBuf::from) else {
        return;
    };
    // About 100 mm both; the second turned by a quarter about z and moved, so that it crosses the
    // first.
    let turned = |at: DVec3| DVec3::new(-at.y, at.x, at.z) + DVec3::new(4e-3, -3e-3, 6e-3);
    let placed = |file: &str, turns: bool| {
        let mut mesh = vps::mesh::load(&folder.join(file), 1.0).unwrap();
        let (low, high) = mesh
            .vertices
            .iter()
            .fold((mesh.vertices[0], mesh.vertices[0]), |(l, h), at| (l.min(*at), h.max(*at)));
        let scale = 0.1 / (high - low).max_element();
        for at in &mut mesh.vertices {
            *at = (*at - 0.5 * (low + high)) * scale;
            *at = if turns { turned(*at) } else { *at };
        }
        let points = crate::sample(&mesh, 1.2e-3).unwrap();
        (mesh, points)
    };
    let step_m = 5e-4;
    let along = |n: usize| (n as f64 - 119.37) * step_m;
    let grid: Vec<(f64, f64)> = (0..240 * 240).map(|n| (along(n / 240), along(n % 240))).collect();
    for (one, other) in
        [("rocker-arm.obj", "rocker-arm.obj"), ("stanford-bunny.obj", "rocker-arm.obj")]
    {
        let ((first, first_points), (second, second_points)) =
            (placed(one, false), placed(other, true));
        let first_m = crossings_m(&first, &grid);
        let second_m = crossings_m(&second, &grid);
        let settings = Settings { region_map: None, raster: [72; 3], air_m: 5e-3, ..settings() };
        let other_surface =
            PointSurface::build(second_points, PointSurface::DEFAULT_NEIGHBOURS).unwrap();
        let model = |points: PointSet| ClayModel::new(points, settings.clone()).unwrap();
        let whole_m3 = model(first_points.clone()).volume_m3().unwrap();
        for boolean in [Boolean::Union, Boolean::Intersection, Boolean::Difference] {
            let lines = first_m
                .iter()
                .zip(&second_m)
                .map(|(first, second)| length_m(boolean, first, second));
            let expected_m3 = lines.sum::<f64>() * step_m * step_m;
            let mut model = model(first_points.clone());
            model.combine(boolean, &other_surface, true).unwrap();
            let found_m3 = model.volume_m3().unwrap();
            assert!(
                (found_m3 - expected_m3).abs() < 0.02 * whole_m3,
                "{one}, {boolean:?}: {found_m3} m³, expected {expected_m3} m³"
            );
        }
    }
}
