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
        material: Material { creep_s: 0.05, acceleration_max_m_per_s2: f64::INFINITY, ..Material::default() },
        ..Settings::default()
    }
}

pub(super) fn ball() -> ClayModel {
    ClayModel::new(sphere(4000, R), settings()).unwrap()
}

/// Pulls the pole up, or pushes it down, in 50 updates.
pub(super) fn stroke(piece: &mut ClayModel, force_n: f64) {
    for _ in 0..50 {
        let top = piece.onto(DVec3::Z * R, 0.01).map_or(DVec3::Z * R, |(at, _)| at);
        piece
            .pull(&PullForce {
                along_map: vec![top],
                force_n: DVec3::Z * force_n,
                reach_m: 3e-3,
                radius_m: 5e-3,
                falloff: Falloff::Gaussian,
            })
            .unwrap();
        piece.advance(4e-3);
    }
    piece.end_stroke().unwrap();
}

fn top_m(piece: &ClayModel) -> f64 {
    piece.points().positions_map.iter().map(|at| at.z).fold(0.0, f64::max)
}

#[test]
fn acceptance_31_a_stroke_moves_the_surface_its_samples_and_its_fits_together() {
    for force_n in [10.0, -10.0] {
        let mut piece = ball();
        stroke(&mut piece, force_n);
        let moved = piece.onto(DVec3::Z * R, 0.01).unwrap().0.z - R;
        assert!(moved * force_n.signum() > 1e-3, "{force_n} N moved it by {moved} m");
        let samples: Vec<u32> = (0..piece.points().len() as u32).collect();
        assert!(resample::largest_gap_m(piece.points(), &samples, piece.gap_m()) <= piece.gap_m());
        for (at, normal) in piece.points().positions_map.iter().zip(&piece.points().normals_map) {
            let off = piece.density_m(*at).unwrap();
            assert!(off.abs() < 0.1 * piece.region().lattice().spacing_m, "{at}: {off} m off in the densities");
            let fitted = piece.surface().at(*at).value_m;
            assert!(fitted.abs() < 0.2 * piece.surface().spacing_m(), "{at}: {fitted} m off in the fits");
            assert!(normal.is_normalized());
        }
        // Far from the stroke nothing has moved.
        let before = sphere(4000, R);
        let far = before.positions_map.iter().filter(|at| at.z < 0.0);
        assert!(far.clone().all(|at| piece.points().positions_map.contains(at)));
    }
}

#[test]
fn what_a_force_hardly_reaches_stays_to_the_bit() {
    // All of the ball deforms.
    let mut piece = ClayModel::new(sphere(4000, R), Settings { region_map: None, ..settings() }).unwrap();
    let (points, base) = (piece.points().clone(), piece.base().clone());
    stroke(&mut piece, 10.0);
    assert!(top_m(&piece) > R + 1e-3, "{}", top_m(&piece));
    let is_below = |at: &DVec3| at.z < -0.5 * R;
    let below = |points: &PointSet| -> Vec<(DVec3, DVec3)> {
        let all = points.positions_map.iter().copied().zip(points.normals_map.iter().copied());
        all.filter(|(at, _)| is_below(at)).collect()
    };
    let (mut was, mut is) = (below(&points), below(piece.points()));
    let by_place = |one: &(DVec3, DVec3), other: &(DVec3, DVec3)| one.0.x.total_cmp(&other.0.x).then(one.0.y.total_cmp(&other.0.y));
    was.sort_by(by_place);
    is.sort_by(by_place);
    assert!(was.len() > 900 && was == is, "{} samples, {} samples", was.len(), is.len());
    let lattice = base.lattice();
    let [nx, ny, nz] = lattice.dims;
    let nodes = (0..nx).flat_map(|x| (0..ny).flat_map(move |y| (0..nz).map(move |z| [x, y, z])));
    for node in nodes.filter(|node| is_below(&lattice.position(*node))) {
        let at = lattice.index(node);
        assert_eq!(piece.base().values_m()[at], base.values_m()[at], "{node:?}");
    }
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn strokes_are_taken_back_and_done_again() {
    let mut piece = ball();
    let start = (piece.points().clone(), piece.base().clone());
    let at = DVec3::new(1e-3, 2e-3, R);
    let fitted = piece.surface().at(at);
    stroke(&mut piece, 10.0);
    let first = (piece.points().clone(), piece.base().clone());
    stroke(&mut piece, -5.0);
    let second = (piece.points().clone(), piece.base().clone());
    assert_eq!(piece.history(), (2, 0));
    let is = |piece: &ClayModel, (points, base): &(PointSet, Arc<Raster>)| {
        piece.points() == points && piece.base().values_m() == base.values_m()
    };
    assert!(piece.undo().unwrap() && is(&piece, &first));
    assert!(piece.undo().unwrap() && is(&piece, &start));
    assert_eq!(piece.surface().at(at), fitted, "fits come back to the bit");
    assert!(!piece.undo().unwrap());
    assert!(piece.redo().unwrap() && is(&piece, &first));
    assert!(piece.redo().unwrap() && is(&piece, &second));
    assert!(!piece.redo().unwrap());
    piece.undo().unwrap();
    stroke(&mut piece, 3.0);
    assert_eq!(piece.history(), (2, 0), "a new stroke leaves nothing to be done again");
}

#[test]
fn what_can_be_taken_back_is_bounded_by_memory_too() {
    let mut piece = ball();
    let before = piece.moment();
    stroke(&mut piece, 3.0);
    let after = piece.moment();
    let left = |mut past: Vec<Snapshot>, bytes_max: usize| {
        undo_history::forget(&mut past, bytes_max);
        past.len()
    };
    let n_bytes = before.n_bytes(Some(&after)) + after.n_bytes(None);
    assert_eq!(left(vec![before.clone(), after.clone()], n_bytes), 2);
    assert_eq!(left(vec![before.clone(), after.clone()], n_bytes - 1), 1);
    assert_eq!(left(vec![before.clone(), after.clone()], 0), 1, "the last stroke can be taken back whatever it takes");
    // Material that was painted once is counted once.
    let mut painted = after.clone();
    let mut coat = MaterialCoat::over(
        &after.material_map,
        after.base.lattice().n_nodes(),
        Painted { mass_kg: Some(1.0), ..Painted::default() },
    );
    let dab = Dab { at_map: DVec3::ZERO, normal_map: DVec3::Z, radius_m: R };
    coat.dab(&mut painted.material_map, (after.base.lattice(), &Material::default()), &Falloff::Constant, dab);
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
            let mut piece = ball();
            stroke(&mut piece, 10.0);
            (piece.points().clone(), piece.base().values_m().to_vec())
        })
    };
    assert!(on(1) == on(4));
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_bite_is_taken_out_and_an_image_stands_out() {
    let mut piece = ball();
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
        piece.combine(Boolean::Difference, &bite, is_sharp).unwrap();
        let middle = piece.base().at(DVec3::X * 0.015).unwrap().value_m;
        assert!(middle < -3e-3, "{middle} m where the bite was");
        let left = piece.base().at(-DVec3::X * 0.015).unwrap().value_m;
        assert!(left > 3e-3, "{left} m where nothing was taken");
        assert!(piece.undo().unwrap());
    }
    let white = GreyImage::new(2, 2, vec![1.0; 4]).unwrap();
    let placement = ImagePlacement::Around { center_map: DVec3::ZERO, north_map: DVec3::Z, front_map: DVec3::X };
    assert_eq!(piece.emboss(&white, &placement, 1e-3).unwrap(), 4000);
    assert!((top_m(&piece) - (R + 1e-3)).abs() < 1e-4, "{}", top_m(&piece));
}

#[test]
fn a_frame_shows_the_region_as_it_is() {
    let mut piece = ball();
    let lattice = Lattice { origin_map: DVec3::ZERO, spacing_m: 1.0, dims: [2; 3] };
    let nothing = Raster::uniform(lattice, 0.0);
    let mut frame = Frame { sequence: 0, base: Arc::new(nothing.clone()), region: nothing, rope_map: None, is_leap: false };
    for sequence in 1..4 {
        piece.advance(4e-3);
        piece.show(&mut frame);
        assert_eq!((frame.sequence, frame.region.values_m()), (sequence, piece.region().values_m()));
        assert!(Arc::ptr_eq(&frame.base, piece.base()));
        // Nodes of the region are nodes of the base, with its densities where nothing moves.
        let corner = frame.region.lattice().position([0, 0, 0]);
        assert_eq!(frame.region.at(corner).unwrap().value_m, frame.base.at(corner).unwrap().value_m);
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
    assert!(matches!(refused(|settings| settings.region_map = Some((DVec3::ONE, DVec3::ZERO))), ClayModelError::Region(..)));
    assert!(matches!(refused(|settings| settings.region_map = Some((DVec3::NAN, DVec3::ZERO))), ClayModelError::Region(..)));
    let fine = refused(|settings| settings.region_map = Some((DVec3::ZERO, DVec3::splat(1e-4))));
    assert!(matches!(fine, ClayModelError::TooFine { .. }), "{fine}");
    let few = ClayModel::new(sphere(3, R), settings()).map(drop).unwrap_err();
    assert!(matches!(few, ClayModelError::Surface(SurfaceError::TooFew { found: 3 })), "{few}");
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn edges_and_relief_far_from_a_boolean_or_an_image_stay_as_they_are() {
    let bite = |at: DVec3| PointSurface::build(shapes_at(at), PointSurface::DEFAULT_NEIGHBOURS).unwrap();
    for region_map in [None, settings().region_map] {
        let mut piece = ClayModel::new(sphere(4000, R), Settings { region_map, ..settings() }).unwrap();
        piece.combine(Boolean::Difference, &bite(DVec3::X * R), true).unwrap();
        let base = piece.base().clone();
        let lattice = *base.lattice();
        // Nodes at the first bite, in its edge among others.
        let [nx, ny, nz] = lattice.dims;
        let nodes = (0..nx).flat_map(|x| (0..ny).flat_map(move |y| (0..nz).map(move |z| [x, y, z])));
        let there: Vec<DVec3> =
            nodes.map(|node| lattice.position(node)).filter(|at| at.x > 0.5 * R && at.length() < 1.2 * R).collect();
        assert!(there.len() > 500, "{}", there.len());
        let is_as_before = |piece: &ClayModel, what: &str| {
            for at in &there {
                let [was_m, is_m] = [&base, piece.base()].map(|base| f64::from(base.at(*at).unwrap().value_m));
                assert!((was_m - is_m).abs() < 1e-3 * lattice.spacing_m, "{what}, {region_map:?}: {was_m} became {is_m} m at {at}");
            }
        };
        piece.combine(Boolean::Difference, &bite(DVec3::X * -R), true).unwrap();
        is_as_before(&piece, "a sharp bite");
        piece.combine(Boolean::Difference, &bite(DVec3::new(-0.4, -1.0, 0.0) * R), false).unwrap();
        is_as_before(&piece, "a blended bite");
        let image = GreyImage::new(4, 4, vec![1.0; 16]).unwrap();
        let placement = ImagePlacement::Flat {
            middle_map: DVec3::new(-0.3 * R, 0.0, 0.95 * R),
            right_map: DVec3::X * 3e-3,
            up_map: DVec3::Y * 3e-3,
        };
        assert!(piece.emboss(&image, &placement, 1e-3).unwrap() > 10);
        is_as_before(&piece, "an image");
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
    let mut piece = ball();
    stroke(&mut piece, 10.0);
    piece.undo().unwrap();
    assert_eq!(piece.history(), (0, 1));
    let before = (piece.points().clone(), piece.base().clone(), piece.strokes());
    stroke(&mut piece, 1e-4);
    assert_eq!(piece.history(), (0, 1));
    assert!(*piece.points() == before.0 && **piece.base() == *before.1 && piece.strokes() == before.2);
    assert!(piece.region().values_m().iter().zip(cut_out(&piece).values_m()).all(|(now, rest)| now == rest));
    assert!(piece.redo().unwrap());
    assert!(top_m(&piece) > R + 1e-3);
}

fn cut_out(piece: &ClayModel) -> Raster {
    cut(piece.base(), lattices::first_node(piece.base().lattice(), piece.region().lattice()), *piece.region().lattice())
}

#[test]
fn a_brush_that_covers_no_sample_makes_no_stroke() {
    let mut piece = ball();
    let brush = |radius_max_m| Brush {
        color: [255, 0, 0],
        radius_m_per_n: 1e-3,
        radius_max_m,
        falloff: Falloff::Gaussian,
        smallest_m: piece.smallest_disc_m(),
    };
    let (faint, broad) = (brush(1e-9), brush(5e-3));
    assert_eq!(piece.paint(&faint, DVec3::new(1e-4, 2e-4, R), 1.0).unwrap(), 0);
    assert!(!piece.is_stroke());
    assert_eq!((piece.history(), piece.strokes()), ((0, 0), 0));
    assert!(piece.paint(&broad, DVec3::Z * R, 3.0).unwrap() > 10);
    assert!(piece.is_stroke());
    piece.end_stroke().unwrap();
    assert_eq!((piece.history(), piece.strokes()), ((1, 0), 1));
}

#[test]
fn a_painted_rim_stays_fine_when_the_surface_beside_it_is_worked() {
    let mut piece = ball();
    let brush = Brush {
        color: [255, 0, 0],
        radius_m_per_n: 1e-3,
        radius_max_m: 4e-3,
        falloff: Falloff::Constant,
        smallest_m: piece.smallest_disc_m(),
    };
    let aside = DVec3::new(0.45, 0.0, (1.0_f64 - 0.45 * 0.45).sqrt()) * R;
    piece.paint(&brush, aside, 10.0).unwrap();
    piece.end_stroke().unwrap();
    let n_rim = |piece: &ClayModel| piece.points().positions_map.iter().filter(|at| at.distance(aside) < 6e-3).count();
    let painted = n_rim(&piece);
    assert!(painted > 2 * n_rim(&ball()), "{painted} of {}", n_rim(&ball()));
    stroke(&mut piece, -6.0);
    assert!(n_rim(&piece) as f64 > 0.9 * painted as f64, "{} of {painted}", n_rim(&piece));
}
