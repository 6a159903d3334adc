//! Where a point of the tool is in the clay: density, way out, and how far it is to the virtual
//! contact point.
//!
//! # Units and frames
//! Points in tool axes about the centre of mass go to node coordinates of the base raster in `f32`,
//! by one affine map made in `f64`. Ways and lengths inside are in spacings; what comes out is in
//! metres and tool axes.
//!
//! # Source
//! Guo2004, haptic painting (direction: the gradient interpolated from the eight corners;
//! magnitude: the virtual contact point, where the ray along it meets the surface); the search
//! along the ray is ours.

use glam::{Mat3, Vec3};

use super::{DensityFrame, Raster};
use crate::spatial::Pose;

/// Times that the search goes on outwards, twice as far each time: from a quarter of a spacing to
/// 64 spacings.
const STRIDES: u32 = 8;
/// The surface is looked for up to this many densities away, and so many spacings more.
const FARTHEST: (f32, f32) = (2.0, 1.0);
/// Shortest first stride, spacings.
const STRIDE_MIN: f32 = 0.25;
/// Steps that close in on the surface once it is passed.
const CLOSING_STEPS: u32 = 6;
/// Density at which a place counts as on the surface, spacings.
const ON_SURFACE: f32 = 1e-6;
/// By how much rounding may move a point, spacings.
const ROUNDING: f32 = 1e-3;
/// Least slope that a first stride is computed with: flatter is not steeper than it looks.
const SLOPE_MIN: f32 = 0.5;

/// A frame as the tool sees it from where it stands.
#[derive(Clone, Copy, Debug)]
pub struct Probe<'a> {
    base: &'a Raster,
    region: &'a Raster,
    /// Spacings per metre; columns are the images of the body axes.
    axes: Mat3,
    /// The centre of mass in nodes of the base.
    origin: Vec3,
    /// The region's first node in nodes of the base.
    region_from: Vec3,
    /// The base's last node.
    last: Vec3,
    spacing_m: f32,
    /// Bound of |∇s|, at least 1.
    steepest: f32,
}

/// How a point inside the clay is pushed out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WayOut {
    /// Unit vector, tool axes.
    pub direction_body: Vec3,
    /// Distance to the virtual contact point, m.
    pub depth_m: f32,
}

impl<'a> Probe<'a> {
    /// RT: safe.
    pub fn new(frame: &'a DensityFrame, map_from_body: Pose) -> Self {
        let base = &*frame.base;
        let region = &frame.region;
        let lattice = base.lattice();
        let per_metre = 1.0 / lattice.spacing_m;
        Self {
            base,
            region,
            axes: (map_from_body.rotation_matrix() * per_metre).as_mat3(),
            // The subtraction in f64: what is left is small, whatever the origin.
            origin: ((map_from_body.translation - lattice.origin_map) * per_metre).as_vec3(),
            region_from: ((region.lattice().origin_map - lattice.origin_map) * per_metre).as_vec3(),
            last: Vec3::from_array(lattice.dims.map(|n| n as f32)) - 1.0,
            spacing_m: lattice.spacing_m as f32,
            steepest: base.steepest().max(region.steepest()).max(1.0),
        }
    }

    /// Distance of the nodes, m.
    pub fn spacing_m(&self) -> f32 {
        self.spacing_m
    }

    /// A point of the tool, m, in nodes of the base.
    #[inline]
    pub fn nodes(&self, point_body: Vec3) -> Vec3 {
        let Mat3 { x_axis, y_axis, z_axis } = self.axes;
        x_axis * point_body.x + y_axis * point_body.y + z_axis * point_body.z + self.origin
    }

    /// The density, m; `None` outside the base.
    #[inline]
    pub fn value_m(&self, nodes: Vec3) -> Option<f32> {
        self.region
            .value_at_nodes(nodes - self.region_from)
            .or_else(|| self.base.value_at_nodes(nodes))
    }

    /// How far a place is proven to be from any material, m; 0 where nothing is proven. A place
    /// that is not a number is nowhere near.
    ///
    /// A density of −v is at least v / max |∇s| away from one of 0; outside of the base there is
    /// nothing.
    #[inline]
    pub fn clearance_m(&self, nodes: Vec3) -> f32 {
        match self.value_m(nodes) {
            Some(value_m) => (-value_m).max(0.0) / self.steepest,
            None if nodes.is_nan() => f32::INFINITY,
            None => {
                ((nodes - nodes.clamp(Vec3::ZERO, self.last)).length() - ROUNDING).max(0.0)
                    * self.spacing_m
            }
        }
    }

    /// How far a sphere is proven to be from any material, m; not above 0 when nothing is proven.
    #[inline]
    pub fn sphere_clearance_m(&self, center_body: Vec3, radius_m: f32) -> f32 {
        self.clearance_m(self.nodes(center_body)) - radius_m - ROUNDING * self.spacing_m
    }

    /// How a place with a density above 0 is pushed out; the `fallback`, unit, tool axes, where the
    /// density does not say which way. RT: safe; at most `STRIDES` + `CLOSING_STEPS` + 6 look-ups.
    pub fn way_out(&self, nodes: Vec3, value_m: f32, fallback: Vec3) -> WayOut {
        let gradient = self.gradient(nodes, value_m);
        let body_from_map = self.axes.transpose() * self.spacing_m;
        let (outward, slope) = match (-gradient).try_normalize() {
            Some(outward) => (outward, gradient.length()),
            None => (self.axes * fallback * self.spacing_m, 0.0),
        };
        let depth_m = self.depth(nodes, outward, (value_m, slope)) * self.spacing_m;
        WayOut { direction_body: body_from_map * outward, depth_m }
    }

    /// ∇s, m/m: central differences at the eight corners, interpolated; where a neighbour is
    /// missing, one-sided.
    ///
    /// Interpolation commutes with a shift by whole nodes: the mean of the corners' differences is
    /// the difference of two interpolations.
    fn gradient(&self, nodes: Vec3, value_m: f32) -> Vec3 {
        let along = |axis: Vec3| {
            let low = self.value_m(nodes - axis);
            let high = self.value_m(nodes + axis);
            let spacings = if low.is_some() && high.is_some() { 2.0 } else { 1.0 };
            (high.unwrap_or(value_m) - low.unwrap_or(value_m)) / (spacings * self.spacing_m)
        };
        Vec3::new(along(Vec3::X), along(Vec3::Y), along(Vec3::Z))
    }

    /// Where the ray first gets out of the clay, spacings: outwards until the surface is passed,
    /// then regula falsi (Illinois). A ray that is still inside far beyond what the density says
    /// has lost its way, as from the middle of a ball: then the density counts.
    fn depth(&self, nodes: Vec3, outward: Vec3, (value_m, slope): (f32, f32)) -> f32 {
        // Beyond the base is air, of which no more is known.
        let value_at = |way: f32| self.value_m(nodes + outward * way).unwrap_or(-value_m);
        let mut inside = 0.0;
        let mut value_inside = value_m;
        let mut stride = (value_m / (slope.max(SLOPE_MIN) * self.spacing_m)).max(STRIDE_MIN);
        let straight = value_m / self.spacing_m;
        let farthest = FARTHEST.0 * straight + FARTHEST.1;
        let mut passed = None;
        for _ in 0..STRIDES {
            if inside >= farthest {
                break;
            }
            let way = (inside + stride).min(farthest);
            let value = value_at(way);
            if value > 0.0 {
                (inside, value_inside) = (way, value);
                stride *= 2.0;
            } else {
                passed = Some((way, value));
                break;
            }
        }
        let Some((mut outside, mut value_outside)) = passed else { return straight };
        let on_surface_m = ON_SURFACE * self.spacing_m;
        let mut last_side = 0_i8;
        for _ in 0..CLOSING_STEPS {
            let way = closing(inside, outside, value_inside, value_outside);
            let value = value_at(way);
            if value.abs() <= on_surface_m {
                return way;
            }
            let side = if value > 0.0 { 1 } else { -1 };
            if side > 0 {
                (inside, value_inside) = (way, value);
                value_outside *= if last_side == side { 0.5 } else { 1.0 };
            } else {
                (outside, value_outside) = (way, value);
                value_inside *= if last_side == side { 0.5 } else { 1.0 };
            }
            last_side = side;
        }
        closing(inside, outside, value_inside, value_outside)
    }
}

/// Where the line through two values, one of them above 0 and the other not, is 0.
fn closing(inside: f32, outside: f32, value_inside: f32, value_outside: f32) -> f32 {
    inside + (outside - inside) * (value_inside / (value_inside - value_outside))
}
