use std::f64::consts::PI;

use super::*;
use crate::haptics::clay::{Lattice, Raster};
use crate::sculpt::sphere;

/// Share of a lattice's cells that are inside, as a volume, m³: exact for a plane that cuts cells, by a smoothed step.
fn volume_m3(raster: &Raster) -> f64 {
    let spacing_m = raster.lattice().spacing_m;
    let share = |value_m: &f32| (0.5 + f64::from(*value_m) / spacing_m).clamp(0.0, 1.0);
    raster.values_m().iter().map(share).sum::<f64>() * spacing_m.powi(3)
}

fn lattice_around(surface: &PointSurface, margin_m: f64, n: usize) -> Lattice {
    let (low, high) = surface.bounds();
    let spacing_m = ((high - low).max_element() + 2.0 * margin_m) / (n - 1) as f64;
    let dims = ((high - low + 2.0 * margin_m) / spacing_m).to_array().map(|extent| extent.ceil() as usize + 1);
    Lattice { origin_map: low - margin_m, spacing_m, dims }
}

#[test]
fn acceptance_28_a_sphere_of_4500_samples_is_followed() {
    let radius_m = 0.05;
    let surface = PointSurface::build(sphere(4500, radius_m), PointSurface::DEFAULT_NEIGHBOURS).unwrap();
    let (mut worst_m, mut worst_angle): (f64, f64) = (0.0, 0.0);
    for at in &surface.points().positions_map {
        let found = surface.at(*at);
        worst_m = worst_m.max(found.value_m.abs());
        worst_angle = worst_angle.max(found.gradient.angle_between(-*at));
    }
    assert!(worst_m <= 1e-3 * surface.spacing_m(), "{} spacings", worst_m / surface.spacing_m());
    assert!(worst_angle.to_degrees() <= 2.0, "{}°", worst_angle.to_degrees());
}

#[test]
fn a_rasterized_sphere_has_its_volume_and_the_values_of_the_field() {
    let surface = PointSurface::build(sphere(4500, 0.05), PointSurface::DEFAULT_NEIGHBOURS).unwrap();
    let raster = surface.rasterize(lattice_around(&surface, 0.01, 48));
    let share = volume_m3(&raster) / (4.0 / 3.0 * PI * 0.05_f64.powi(3));
    assert!((share - 1.0).abs() < 2e-3, "{share}");
    let lattice = raster.lattice();
    for (place, value_m) in raster.values_m().iter().enumerate() {
        let [_, ny, nz] = lattice.dims;
        let at = lattice.position([place / nz / ny, place / nz % ny, place % nz]);
        let found = surface.at(at);
        assert!((found.value_m - f64::from(*value_m)).abs() < 1e-8, "{at}: {found:?} {value_m}");
        let depth_m = 0.05 - at.length();
        assert!(depth_m.abs() < 1e-4 || (depth_m > 0.0) == (found.value_m > 0.0), "{at}: {found:?}");
    }
}
