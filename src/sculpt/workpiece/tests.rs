use super::*;
use crate::sculpt::falloff::Falloff;
use crate::sculpt::shapes::sphere;

const R: f64 = 0.02;

fn settings() -> Settings {
    Settings {
        region_map: Some((DVec3::new(-0.012, -0.012, 0.008), DVec3::new(0.012, 0.012, 0.032))),
        raster: [31; 3],
        air_m: 5e-3,
        material: Material { creep_s: 0.05, acceleration_max_m_per_s2: f64::INFINITY, ..Material::default() },
        ..Settings::default()
    }
}

fn ball() -> Workpiece {
    Workpiece::new(sphere(4000, R), settings()).unwrap()
}

/// Pulls the pole up, or pushes it down, in 50 updates.
fn stroke(piece: &mut Workpiece, force_n: f64) {
    for _ in 0..50 {
        let top = piece.onto(DVec3::Z * R, 0.01).map_or(DVec3::Z * R, |(at, _)| at);
        piece
            .pull(&Pull {
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

fn top_m(piece: &Workpiece) -> f64 {
    piece.points().positions_map.iter().map(|at| at.z).fold(0.0, f64::max)
}

#[test]
fn a_stroke_moves_the_surface_its_samples_and_its_fits_together() {
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
    let mut piece = Workpiece::new(sphere(4000, R), Settings { region_map: None, ..settings() }).unwrap();
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
fn strokes_are_taken_back_and_done_again() {
    let mut piece = ball();
    let start = (piece.points().clone(), piece.base().clone());
    stroke(&mut piece, 10.0);
    let first = (piece.points().clone(), piece.base().clone());
    stroke(&mut piece, -5.0);
    let second = (piece.points().clone(), piece.base().clone());
    assert_eq!(piece.history(), (2, 0));
    let is = |piece: &Workpiece, (points, base): &(PointSet, Arc<Raster>)| {
        piece.points() == points && piece.base().values_m() == base.values_m()
    };
    assert!(piece.undo().unwrap() && is(&piece, &first));
    assert!(piece.undo().unwrap() && is(&piece, &start));
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
    let left = |mut past: Vec<Moment>, bytes_max: usize| {
        past::forget(&mut past, bytes_max);
        past.len()
    };
    let n_bytes = before.n_bytes() + after.n_bytes();
    assert_eq!(left(vec![before.clone(), after.clone()], n_bytes), 2);
    assert_eq!(left(vec![before.clone(), after.clone()], n_bytes - 1), 1);
    assert_eq!(left(vec![before.clone(), after], 0), 1, "the last stroke can be taken back whatever it takes");
    // Strokes of paint have one raster between them.
    let painted = vec![before.clone(); 3];
    assert_eq!(left(painted.clone(), before.n_bytes() + 2 * before.points.n_bytes()), 3);
    assert_eq!(left(painted, before.n_bytes() + 2 * before.points.n_bytes() - 1), 2);
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
    let laid = Laid::Around { center_map: DVec3::ZERO, north_map: DVec3::Z, front_map: DVec3::X };
    assert_eq!(piece.emboss(&white, &laid, 1e-3).unwrap(), 4000);
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
        Workpiece::new(sphere(500, R), settings).map(drop).unwrap_err()
    };
    assert!(matches!(refused(|settings| settings.raster = [3, 10, 10]), WorkpieceError::Raster(_)));
    assert!(matches!(refused(|settings| settings.region_map = Some((DVec3::ONE, DVec3::ZERO))), WorkpieceError::Region(..)));
    assert!(matches!(refused(|settings| settings.region_map = Some((DVec3::NAN, DVec3::ZERO))), WorkpieceError::Region(..)));
    let fine = refused(|settings| settings.region_map = Some((DVec3::ZERO, DVec3::splat(1e-4))));
    assert!(matches!(fine, WorkpieceError::TooFine { .. }), "{fine}");
    let few = Workpiece::new(sphere(3, R), settings()).map(drop).unwrap_err();
    assert!(matches!(few, WorkpieceError::Surface(SurfaceError::TooFew { found: 3 })), "{few}");
}
