//! The base, and the region in it.

use glam::DVec3;

use super::settings::{ClayModelError, NODES_MAX, Settings};
use vps::density::{Lattice, Raster};

/// Air around all samples in the base raster, in its spacings: room for what is pulled out, beyond
/// what the caller asks for.
const AIR_SPACINGS: f64 = 4.0;
/// A lattice is kept until one as large as the clay needs would be finer than this, in its
/// spacings.
const KEPT_SPACINGS: f64 = 0.75;

/// Lowest and highest corner of what deforms, of clay in a box (map frame, m).
pub(in super::super) fn region_box(
    (low, high): (DVec3, DVec3),
    settings: &Settings,
) -> (DVec3, DVec3) {
    settings.region_map.unwrap_or((low - settings.air_m, high + settings.air_m))
}

/// The lattice of the base, the first node of the region in it, and the lattice of the region.
pub(in super::super) fn lattices(
    (low, high): (DVec3, DVec3),
    settings: &Settings,
) -> Result<(Lattice, [usize; 3], Lattice), ClayModelError> {
    let dims = settings.raster;
    if dims.iter().any(|n| *n < 4) {
        return Err(ClayModelError::Raster(dims));
    }
    let (region_low, region_high) = region_box((low, high), settings);
    let low = low - settings.air_m;
    let high = high + settings.air_m;
    if !(region_high.cmpgt(region_low).all() && region_low.is_finite() && region_high.is_finite()) {
        return Err(ClayModelError::Region(region_low, region_high));
    }
    // One spacing for all axes; the box grows about its middle to hold whole steps of it.
    let steps = DVec3::from_array(dims.map(|n| (n - 1) as f64));
    let spacing_m = ((region_high - region_low) / steps).max_element();
    let origin = 0.5 * (region_low + region_high) - 0.5 * spacing_m * steps;
    let region = Lattice { origin_map: origin, spacing_m, dims };
    // The base goes on from there to all sides.
    let nodes_below = ((origin - low) / spacing_m + AIR_SPACINGS).ceil().max(DVec3::ZERO);
    let last = origin + spacing_m * steps;
    let nodes_above = ((high - last) / spacing_m + AIR_SPACINGS).ceil().max(DVec3::ZERO);
    let nodes = nodes_below + steps + nodes_above + 1.0;
    let n_nodes = nodes.element_product();
    let fits = n_nodes <= NODES_MAX as f64;
    if !fits {
        return Err(ClayModelError::TooFine { spacing_m, n_nodes });
    }
    let whole = Lattice {
        origin_map: origin - nodes_below * spacing_m,
        spacing_m,
        dims: nodes.to_array().map(|n| n as usize),
    };
    Ok((whole, nodes_below.to_array().map(|n| n as usize), region))
}

/// The lattices of a clay model that has become another, for those of `now` (base, region): the
/// same nodes wherever they will do, since densities that are looked up between nodes lose their
/// edges.
pub(super) fn lattices_after(
    (whole, region): (&Lattice, &Lattice),
    (low, high): (DVec3, DVec3),
    settings: &Settings,
) -> Result<(Lattice, [usize; 3], Lattice), ClayModelError> {
    let fresh = lattices((low, high), settings)?;
    let (region_low, region_high) = region.bounds();
    let holds_all = (low - settings.air_m).cmpge(region_low).all()
        && (high + settings.air_m).cmple(region_high).all();
    let is_fine =
        region.dims == settings.raster && KEPT_SPACINGS * region.spacing_m <= fresh.2.spacing_m;
    let stays = settings.region_map.is_none() && holds_all && is_fine;
    Ok(if stays { (*whole, first_node(whole, region), *region) } else { fresh })
}

/// Whether a raster has two nodes around these bounds on every side.
pub(super) fn has_room(lattice: &Lattice, (low, high): (DVec3, DVec3)) -> bool {
    let (first, last) = lattice.bounds();
    let room_m = 2.0 * lattice.spacing_m;
    (low - room_m).cmpge(first).all() && (high + room_m).cmple(last).all()
}

pub(super) fn first_node(whole: &Lattice, part: &Lattice) -> [usize; 3] {
    ((part.origin_map - whole.origin_map) / whole.spacing_m)
        .round()
        .to_array()
        .map(|n| n.max(0.0) as usize)
}

/// The nodes of `part` are nodes of `whole`.
pub(super) fn is_part(whole: &Lattice, part: &Lattice) -> bool {
    let nodes = (part.origin_map - whole.origin_map) / whole.spacing_m;
    let is_on_nodes =
        (nodes - nodes.round()).abs().max_element() < 1e-3 && nodes.min_element() > -0.5;
    let first = first_node(whole, part);
    let is_inside = (0..3).all(|axis| {
        first[axis].checked_add(part.dims[axis]).is_some_and(|n| n <= whole.dims[axis])
    });
    (part.spacing_m / whole.spacing_m - 1.0).abs() < 1e-6 && is_on_nodes && is_inside
}

/// A part of a raster.
pub(super) fn cut(whole: &Raster, first: [usize; 3], part: Lattice) -> Raster {
    let mut raster = Raster::uniform(part, 0.0);
    let [nx, ny, nz] = part.dims;
    for x in 0..nx {
        for y in 0..ny {
            let from = whole.lattice().index([first[0] + x, first[1] + y, first[2]]);
            let to = part.index([x, y, 0]);
            raster.values_m_mut()[to..to + nz].copy_from_slice(&whole.values_m()[from..from + nz]);
        }
    }
    raster
}

/// Puts a part back to where it was cut out.
pub(super) fn copy_into(whole: &mut Raster, part: &Raster, first: [usize; 3]) {
    let [nx, ny, nz] = part.lattice().dims;
    for x in 0..nx {
        for y in 0..ny {
            let to = whole.lattice().index([first[0] + x, first[1] + y, first[2]]);
            let from = part.lattice().index([x, y, 0]);
            whole.values_m_mut()[to..to + nz].copy_from_slice(&part.values_m()[from..from + nz]);
        }
    }
}
