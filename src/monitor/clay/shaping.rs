//! What clients do to clay by numbers rather than by hand: curves, the region, laid material,
//! Booleans at a place. Lengths in m, map frame.

use std::sync::Arc;

use glam::DVec3;
use serde::Deserialize;
use serde_json::Value;

use super::super::asks::PoseAsked;
use super::super::problem::RequestError;
use super::select_tool::{PaintedAsked, falloff_of, painted_of};
use clay::SolidSource;
use clay::boolean::Boolean;
use clay::engine::{ClayView, RopeCurves, SculptOrder};
use clay::falloff::Falloff;
use clay::material_map::{MaterialPlace, Painted};
use vps::mesh::primitives::Shape;
use vps::spatial::Pose;

/// A shape so many times as large as the region is one of a wrong unit.
const OUT_OF_SCALE: f64 = 100.0;

/// Curves for the rope; none: those that were drawn are gone.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::monitor) struct DrawAsked {
    curves_m: Vec<Vec<[f64; 3]>>,
    #[serde(default)]
    is_free: bool,
}

/// Curves, and how they are pulled.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::monitor) struct PullAsked {
    curves_m: Vec<Vec<[f64; 3]>>,
    #[serde(default)]
    is_free: bool,
    force_n: [f64; 3],
    time_s: f64,
    brush_m: Option<f64>,
}

/// A box.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::monitor) struct RegionAsked {
    min: [f64; 3],
    max: [f64; 3],
}

/// A ball.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct BallAsked {
    center: [f64; 3],
    radius_m: f64,
    falloff: Option<Value>,
}

/// From one place to another.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct GradientAsked {
    from: [f64; 3],
    to: [f64; 3],
}

/// A material, and where it is laid; without a place everywhere.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(in crate::monitor) struct LayAsked {
    painted: PaintedAsked,
    r#box: Option<RegionAsked>,
    ball: Option<BallAsked>,
    gradient: Option<GradientAsked>,
}

/// Shapes, with lengths in m.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
enum ShapeAsked {
    /// Radius.
    SphereM(f64),
    /// Half of the extents along x, y and z.
    EllipsoidM([f64; 3]),
    /// Full edges.
    BoxM([f64; 3]),
    /// Radius and height.
    CylinderM([f64; 2]),
    /// Radius of the base and height; the apex is at +z.
    ConeM([f64; 2]),
}

#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum BooleanAsked {
    Union,
    Intersection,
    Difference,
}

/// A Boolean with a shape, or with the solid that was chosen for the tool.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::monitor) struct CombineAsked {
    boolean: BooleanAsked,
    shape: Option<ShapeAsked>,
    /// Where it stands in the map.
    pose: Option<PoseAsked>,
    is_sharp: Option<bool>,
}

fn curves_of(curves_m: Vec<Vec<[f64; 3]>>, is_free: bool) -> RopeCurves {
    let curves_map = curves_m
        .into_iter()
        .map(|curve| curve.into_iter().map(DVec3::from_array).collect())
        .collect();
    RopeCurves { curves_map, is_free }
}

impl DrawAsked {
    pub(in crate::monitor) fn checked(self) -> Result<SculptOrder, RequestError> {
        Ok(SculptOrder::Draw(curves_of(self.curves_m, self.is_free)))
    }
}

impl PullAsked {
    pub(in crate::monitor) fn checked(self) -> Result<SculptOrder, RequestError> {
        let Self { curves_m, is_free, force_n, time_s, brush_m } = self;
        let force_map = DVec3::from_array(force_n);
        let is_sound = |value: f64, most: f64| value > 0.0 && value <= most;
        if !is_sound(force_map.length(), RopeCurves::FORCE_MAX_N) {
            let hint = "its three parts in N; `time_s` says how long it acts";
            let most_n = RopeCurves::FORCE_MAX_N;
            return Err(RequestError::bad(
                format!("`force_n` is a force above 0 and of {most_n} N at most"),
                hint,
            ));
        }
        if !is_sound(time_s, RopeCurves::TIME_MAX_S) {
            let most_s = RopeCurves::TIME_MAX_S;
            return Err(RequestError::bad(
                format!("`time_s` goes above 0 up to {most_s} s, not to {time_s}"),
                "such as 0.5",
            ));
        }
        if let Some(brush_m) = brush_m.filter(|brush_m| !is_sound(*brush_m, 1.0)) {
            return Err(RequestError::bad(
                format!("`brush_m` goes above 0 up to 1 m, not to {brush_m}"),
                "a radius in m",
            ));
        }
        Ok(SculptOrder::Pull { curves: curves_of(curves_m, is_free), force_map, time_s, brush_m })
    }
}

impl RegionAsked {
    fn corners(self) -> Result<(DVec3, DVec3), RequestError> {
        let low = DVec3::from_array(self.min);
        let high = DVec3::from_array(self.max);
        if low.cmplt(high).all() {
            return Ok((low, high));
        }
        Err(RequestError::bad(
            "`max` is to be above `min` along x, y and z",
            "corners of a box in m, in the frame of the clay",
        ))
    }

    pub(in crate::monitor) fn checked(self) -> Result<SculptOrder, RequestError> {
        let (low_map, high_map) = self.corners()?;
        Ok(SculptOrder::Region { low_map, high_map })
    }
}

impl LayAsked {
    pub(in crate::monitor) fn checked(self) -> Result<SculptOrder, RequestError> {
        let painted = painted_of(self.painted)?;
        let place = match (self.r#box, self.ball, self.gradient) {
            (None, None, None) if painted == Painted::default() => {
                return Err(RequestError::bad(
                    "no material is given",
                    "a `painted` with a mass, a damping or a stiffness, or a place",
                ));
            }
            (None, None, None) => MaterialPlace::Everywhere,
            (Some(asked), None, None) => {
                let (low_map, high_map) = asked.corners()?;
                MaterialPlace::Box { low_map, high_map }
            }
            (None, Some(BallAsked { center, radius_m, falloff }), None) => {
                let falloff =
                    falloff.as_ref().map(falloff_of).transpose()?.unwrap_or(Falloff::Constant);
                MaterialPlace::Ball { center_map: DVec3::from_array(center), radius_m, falloff }
            }
            (None, None, Some(GradientAsked { from, to })) => MaterialPlace::Gradient {
                from_map: DVec3::from_array(from),
                to_map: DVec3::from_array(to),
            },
            _ => {
                return Err(RequestError::bad(
                    "material is laid at one place at a time",
                    "one of `box`, `ball` and `gradient`",
                ));
            }
        };
        match place.unsound() {
            Some(what) => {
                Err(RequestError::bad(what, "places and lengths in m, in the frame of the clay"))
            }
            None => Ok(SculptOrder::Lay { painted, place }),
        }
    }
}

impl From<ShapeAsked> for Shape {
    fn from(asked: ShapeAsked) -> Self {
        match asked {
            ShapeAsked::SphereM(radius_m) => Self::Sphere { radius_m },
            ShapeAsked::EllipsoidM(radii_m) => {
                Self::Ellipsoid { radii_m: DVec3::from_array(radii_m) }
            }
            ShapeAsked::BoxM(size_m) => Self::Box { size_m: DVec3::from_array(size_m) },
            ShapeAsked::CylinderM([radius_m, height_m]) => Self::Cylinder { radius_m, height_m },
            ShapeAsked::ConeM([radius_m, height_m]) => Self::Cone { radius_m, height_m },
        }
    }
}

impl ShapeAsked {
    fn lengths_m(self) -> Vec<f64> {
        match self {
            Self::SphereM(radius_m) => vec![radius_m],
            Self::BoxM(lengths_m) | Self::EllipsoidM(lengths_m) => lengths_m.to_vec(),
            Self::CylinderM(lengths_m) | Self::ConeM(lengths_m) => lengths_m.to_vec(),
        }
    }
}

impl CombineAsked {
    pub(in crate::monitor) fn checked(self, view: &ClayView) -> Result<SculptOrder, RequestError> {
        let with = match (self.shape, &view.tool.solid) {
            (Some(shape), _) => {
                let (low, high) = view.region_map;
                let extent_m = (high - low).max_element();
                let range = extent_m / OUT_OF_SCALE..=extent_m * OUT_OF_SCALE;
                if let Some(length_m) =
                    shape.lengths_m().into_iter().find(|length_m| !range.contains(length_m))
                {
                    let error = format!(
                        "a shape with a length of {length_m} m does not go with a region of \
                            {extent_m:.3} m"
                    );
                    return Err(RequestError::bad(error, "lengths are in m"));
                }
                Arc::new(SolidSource::Shape(shape.into(), DVec3::ONE))
            }
            (None, Some(solid)) => solid.source.clone(),
            (None, None) => {
                let hint = "a `shape`, or choose a solid first: PUT /api/v1/clay/solid";
                return Err(RequestError::bad("there is no solid to combine the clay with", hint));
            }
        };
        let boolean = match self.boolean {
            BooleanAsked::Union => Boolean::Union,
            BooleanAsked::Intersection => Boolean::Intersection,
            BooleanAsked::Difference => Boolean::Difference,
        };
        let map_from_body = self.pose.map_or(Pose::IDENTITY, Pose::from);
        let (low, high) = view.region_map;
        let farthest_m = OUT_OF_SCALE * (high - low).max_element();
        // Written so that a NaN is refused as well.
        let is_rotation = (map_from_body.rotation.length_squared() - 1.0).abs() <= 1e-3;
        if !(is_rotation && map_from_body.translation.abs().max_element() <= farthest_m) {
            let error = format!(
                "not a pose for the solid: a unit quaternion, within {farthest_m:.3} m of the \
                    origin of the clay"
            );
            return Err(RequestError::bad(
                error,
                "`pose` is {\"p\": [x, y, z] in m, \"q\": [x, y, z, w]}",
            ));
        }
        let solid_m =
            with.bounds_map(&map_from_body).map_or(0.0, |(low, high)| (high - low).max_element());
        if solid_m > farthest_m {
            let error = format!(
                "a solid of {solid_m:.3} m does not go with a region of {:.3} m",
                farthest_m / OUT_OF_SCALE
            );
            return Err(RequestError::bad(error, "see the unit that it was uploaded with"));
        }
        let is_sharp = self.is_sharp.unwrap_or(view.tool.is_sharp);
        Ok(SculptOrder::Combine { boolean, with, map_from_body, is_sharp })
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::super::tests::view_of;
    use super::*;
    use clay::PointSet;

    fn read<T: for<'d> Deserialize<'d>>(asked: Value) -> T {
        T::deserialize(asked).unwrap()
    }

    fn refusal(result: Result<SculptOrder, RequestError>) -> String {
        result.expect_err("it is refused").said.error
    }

    #[test]
    fn places_of_material_are_one_at_a_time_and_everywhere_without_one() {
        let placed = |asked: Value| match read::<LayAsked>(asked).checked() {
            Ok(SculptOrder::Lay { place, .. }) => Ok(place),
            Ok(other) => panic!("{other:?}"),
            Err(problem) => Err(problem.said.error),
        };
        let hard = json!({ "stiffness_n_per_m": 500.0 });
        assert_eq!(placed(json!({ "painted": hard })), Ok(MaterialPlace::Everywhere));
        let gradient = MaterialPlace::Gradient { from_map: DVec3::ZERO, to_map: DVec3::Z };
        assert_eq!(
            placed(json!({ "gradient": { "from": [0, 0, 0], "to": [0, 0, 1] } })),
            Ok(gradient)
        );
        let ball =
            MaterialPlace::Ball { center_map: DVec3::X, radius_m: 0.5, falloff: Falloff::Gaussian };
        assert_eq!(
            placed(
                json!({ "ball": { "center": [1, 0, 0], "radius_m": 0.5, "falloff": "gaussian" } })
            ),
            Ok(ball)
        );
        for (asked, expected) in [
            (json!({}), "no material"),
            (
                json!({ "box": { "min": [0, 0, 0], "max": [1, 0, 1] } }),
                "`max` is to be above `min`",
            ),
            (json!({ "ball": { "center": [0, 0, 0], "radius_m": -1 } }), "a radius of -1 m"),
            (
                json!({ "gradient": { "from": [0, 0, 0], "to": [0, 0, 0] } }),
                "two places that are one",
            ),
            (json!({ "painted": { "mass_kg": 5.0 } }), "a mass of 5 kg"),
            (
                json!({ "ball": { "center": [0, 0, 0], "radius_m": 1 }, "gradient": { "from": [0, 0, 0], "to": [0, 0, 1] } }),
                "one place at a time",
            ),
        ] {
            let error = placed(asked.clone()).expect_err(&asked.to_string());
            assert!(error.contains(expected), "{asked}: {error}");
        }
    }

    #[test]
    fn a_boolean_takes_a_shape_of_the_size_of_the_clay_or_the_chosen_solid() {
        let view = view_of(PointSet::default(), 1);
        let ask = |asked: Value| read::<CombineAsked>(asked).checked(&view);
        assert!(matches!(
            ask(json!({ "boolean": "difference", "shape": { "cylinder_m": [0.002, 0.05] } })),
            Ok(SculptOrder::Combine { boolean: Boolean::Difference, .. })
        ));
        assert!(
            ask(json!({ "boolean": "union", "shape": { "ellipsoid_m": [0.01, 0.005, 0.02] } }))
                .is_ok()
        );
        assert!(refusal(ask(json!({ "boolean": "union" }))).contains("no solid"));
        assert!(
            refusal(ask(json!({ "boolean": "union", "shape": { "sphere_m": 5.0 } })))
                .contains("5 m does not go with")
        );
        assert!(
            refusal(ask(json!({ "boolean": "union", "shape": { "box_m": [0.01, 0.01, 0.0] } })))
                .contains("0 m does not")
        );
        let at = |p: [f64; 3], q: [f64; 4]| {
            ask(
                json!({ "boolean": "union", "shape": { "sphere_m": 0.01 }, "pose": { "p": p, "q": q } }),
            )
        };
        assert!(at([0.01, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]).is_ok());
        for (p, q) in [
            ([0.0; 3], [0.0, 0.0, 0.0, 2.0]),
            ([0.0; 3], [0.0; 4]),
            ([1e9, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]),
        ] {
            assert!(refusal(at(p, q)).contains("not a pose"), "{p:?} {q:?}");
        }
    }

    #[test]
    fn pulls_without_force_or_time_are_refused() {
        let ask = |force_n: [f64; 3], time_s: f64| {
            read::<PullAsked>(
                json!({ "curves_m": [[[0, 0, 0]]], "force_n": force_n, "time_s": time_s }),
            )
            .checked()
        };
        assert!(ask([0.0, 0.0, 2.0], 0.5).is_ok());
        assert!(refusal(ask([0.0; 3], 0.5)).contains("`force_n`"));
        assert!(refusal(ask([0.0, 0.0, 1001.0], 0.5)).contains("`force_n`"));
        assert!(refusal(ask([0.0, 0.0, 2.0], 61.0)).contains("`time_s`"));
    }
}
