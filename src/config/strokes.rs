//! Files of strokes: what is done to a piece of clay, and when.
//!
//! TOML, `version = 1`, then a `[[stroke]]` table for each, with `at_s` (loop time, s) and `do`; `docs/sculpting.md` lists the keys. Files
//! that are read are relative to the file of strokes, files that are written to the working directory.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use glam::DVec3;

use super::checks::{Checks, FINITE, Interval};
use super::document::Document;
use super::problem::{ConfigErrors, Problem, ProblemKind, any_of};
use super::resolve::{MM, Resolve, WrittenSolid, WrittenTool};
use super::schema::{Deed, Stroke, Strokes};
use crate::sculpt::PointSet;
use crate::sculpt::boolean::Boolean;
use crate::sculpt::emboss::Laid;
use crate::sculpt::studio::{Order, ToolSettings};

/// An order and its loop time.
pub type Timed = (Duration, Order);

const TIME_S: Interval = Interval::from(0.0).to(1e5).unit("s");
/// Cosine of the largest angle by which the edges of an image may be off a right one.
const SKEW: f64 = 1e-3;

/// Reads a file of strokes, with every image and solid that it names, in the order of their times; those of one time stay in the order of the
/// file. `tool`: what is in the hand before, of which a `take` changes what it names.
///
/// # Errors
/// Every problem of the first pass that found any.
pub fn load(path: &Path, tool: &ToolSettings) -> Result<Vec<Timed>, ConfigErrors> {
    let of_file = |kind| ConfigErrors::new(vec![Problem::of_file(path, kind)]);
    let text = fs::read_to_string(path).map_err(|cause| of_file(ProblemKind::Unreadable { cause }))?;
    let document = Document::parse(path, &text)?;
    let Strokes { strokes, .. } = document.read()?;
    let dir = path.parent().unwrap_or(Path::new(""));
    let mut script = Script {
        resolve: Resolve { checks: Checks::new(&document), document: &document, dir },
        tool,
        orders: Vec::new(),
        holds: Vec::new(),
        written: Vec::new(),
    };
    for (index, stroke) in strokes.iter().enumerate() {
        script.stroke(index, stroke);
    }
    script.holds_are_apart();
    let Script { resolve, mut orders, .. } = script;
    resolve.checks.finish()?;
    orders.sort_by_key(|(at, _)| *at);
    Ok(orders)
}

/// The files that orders write.
pub fn outputs(orders: &[Timed]) -> impl Iterator<Item = &Path> {
    orders.iter().filter_map(|(_, order)| match order {
        Order::SavePoints(path) | Order::SaveSession(path) | Order::Export(path) => Some(path.as_path()),
        _ => None,
    })
}

struct Script<'d> {
    resolve: Resolve<'d>,
    tool: &'d ToolSettings,
    orders: Vec<Timed>,
    /// Number of the stroke, from and until, s.
    holds: Vec<(usize, f64, f64)>,
    /// Files and the strokes that write them.
    written: Vec<(usize, PathBuf)>,
}

impl Script<'_> {
    fn stroke(&mut self, index: usize, stroke: &Stroke) {
        let table = format!("stroke[{index}]");
        let at_s = self.resolve.checks.required(&format!("{table}.at_s"), stroke.at_s, TIME_S);
        let Some(deed) = stroke.deed else {
            self.resolve.checks.missing(&format!("{table}.do"), any_of(&Deed::ALL.map(|deed| deed.to_string())));
            return;
        };
        self.only_what_belongs(&table, stroke, deed);
        let at = Duration::try_from_secs_f64(at_s).unwrap_or_default();
        let order = match deed {
            Deed::Take => Some(Order::Take(self.take(&table, stroke))),
            Deed::Hold => {
                self.hold(index, at_s, stroke.until_s);
                return;
            }
            Deed::Union | Deed::Intersection | Deed::Difference => self.combine(&table, stroke, deed),
            Deed::Emboss | Deed::Engrave => self.emboss(&table, stroke, deed),
            Deed::Undo => Some(Order::Undo),
            Deed::Redo => Some(Order::Redo),
            Deed::Region => {
                let key = format!("{table}.region_mm");
                if stroke.region_mm.is_none() {
                    self.resolve.checks.missing(&key, "[[x, y, z], [x, y, z]], the lowest and the highest corner");
                }
                let region = self.resolve.region_m(&key, stroke.region_mm.as_deref());
                region.map(|(low_map, high_map)| Order::Region { low_map, high_map })
            }
            Deed::SavePoints => self.file(index, stroke, Some("ply")).map(Order::SavePoints),
            Deed::SaveSession => self.file(index, stroke, None).map(Order::SaveSession),
            Deed::Export => self.file(index, stroke, Some("ply")).map(Order::Export),
        };
        self.orders.extend(order.map(|order| (at, order)));
    }

    fn take(&mut self, table: &str, stroke: &Stroke) -> ToolSettings {
        let written = WrittenTool {
            tool: stroke.tool,
            brush_mm: stroke.brush_mm,
            falloff: stroke.falloff.as_ref(),
            color: stroke.color.as_deref(),
            depth_mm: stroke.depth_mm,
            image: stroke.image.as_deref(),
            sharp: stroke.sharp,
        };
        self.resolve.tool_settings(table, &written, self.tool)
    }

    fn hold(&mut self, index: usize, at_s: f64, until_s: Option<f64>) {
        let key = format!("stroke[{index}].until_s");
        let until_s = self.resolve.checks.required(&key, until_s, TIME_S);
        if until_s <= at_s {
            self.resolve.checks.not_accepted(&key, format_args!("later than at_s = {at_s} s"));
        }
        self.holds.push((index, at_s, until_s));
        for (time_s, held) in [(at_s, true), (until_s, false)] {
            self.orders.push((Duration::try_from_secs_f64(time_s).unwrap_or_default(), Order::Hold(held)));
        }
    }

    /// What is held twice would be let go by the first end.
    fn holds_are_apart(&mut self) {
        let mut holds = self.holds.clone();
        holds.sort_by(|(_, one_s, _), (_, other_s, _)| one_s.total_cmp(other_s));
        for pair in holds.windows(2) {
            let &[(before, _, until_s), (index, at_s, _)] = pair else { continue };
            let line = self.resolve.document.line(&format!("stroke[{before}]")).unwrap_or_default();
            let accepted = if at_s < until_s {
                format!("{until_s} s or later: until then the tool is held by the stroke in line {line}")
            } else if at_s == until_s && index < before {
                // What happens at one time happens in the order of the file: this one would be let go as soon as it holds.
                format!("later than {until_s} s, or stand below the stroke in line {line}, which holds the tool until then")
            } else {
                continue;
            };
            self.resolve.checks.not_accepted(&format!("stroke[{index}].at_s"), accepted);
        }
    }

    fn combine(&mut self, table: &str, stroke: &Stroke, deed: Deed) -> Option<Order> {
        let boolean = match deed {
            Deed::Intersection => Boolean::Intersection,
            Deed::Difference => Boolean::Difference,
            _ => Boolean::Union,
        };
        let n_before = self.resolve.checks.count();
        let written = WrittenSolid {
            points: stroke.points.as_deref(),
            mesh: stroke.mesh.as_deref(),
            shape: stroke.shape.as_ref(),
            units: stroke.units,
            spacing_mm: stroke.spacing_mm,
        };
        let solid = self.resolve.solid(table, &written, "");
        let map_from_solid = self.resolve.pose(table, stroke.position_mm, stroke.orientation_xyzw);
        if self.resolve.checks.count() > n_before {
            return None;
        }
        let mut points = match solid.load() {
            Ok(loaded) => loaded.points,
            Err(problem) => {
                let key = if stroke.points.is_some() {
                    "points"
                } else if stroke.mesh.is_some() {
                    "mesh"
                } else {
                    "shape"
                };
                self.resolve.checks.refuse(&format!("{table}.{key}"), ProblemKind::Solid(problem));
                return None;
            }
        };
        let PointSet { positions_map, normals_map, .. } = &mut points;
        positions_map.iter_mut().for_each(|at| *at = map_from_solid.transform_point(*at));
        normals_map.iter_mut().for_each(|normal| *normal = map_from_solid.transform_vector(*normal).normalize());
        Some(Order::Combine { boolean, with: Arc::new(points), is_sharp: stroke.sharp.unwrap_or(self.tool.is_sharp) })
    }

    fn emboss(&mut self, table: &str, stroke: &Stroke, deed: Deed) -> Option<Order> {
        let depth = Interval::above(0.0).to(100.0).unit("mm");
        let depth_m = self.resolve.checks.number(&format!("{table}.depth_mm"), stroke.depth_mm, self.tool.depth_m / MM, depth) * MM;
        let image_key = format!("{table}.image");
        let image = match &stroke.image {
            Some(image) => self.resolve.image(&image_key, Some(image)),
            None => {
                let of_scene = self.tool.image.clone();
                if of_scene.is_none() {
                    self.resolve.checks.missing(&image_key, "a PNG file, whose white is deep");
                }
                of_scene
            }
        };
        let laid = match (stroke.corner_mm, stroke.center_mm) {
            (Some(_), Some(_)) => {
                let other = format!("{table}.corner_mm");
                self.resolve.checks.refuse(&format!("{table}.center_mm"), ProblemKind::Exclusive { other });
                None
            }
            (None, None) => {
                let accepted =
                    "the place of its upper left corner, with across_mm and down_mm; or center_mm of a ball that it goes around";
                self.resolve.checks.missing(&format!("{table}.corner_mm"), accepted);
                None
            }
            (Some(_), None) => self.laid_flat(table, stroke),
            (None, Some(_)) => self.laid_around(table, stroke),
        };
        let depth_m = if deed == Deed::Engrave { -depth_m } else { depth_m };
        Some(Order::Emboss { image: image?, laid: laid?, depth_m })
    }

    fn laid_flat(&mut self, table: &str, stroke: &Stroke) -> Option<Laid> {
        self.leave_out(table, &[("axis", stroke.axis.is_some()), ("front", stroke.front.is_some())], "beside corner_mm");
        let mut vector = |name: &str, written| {
            let key = format!("{table}.{name}");
            let found = self.resolve.checks.array(&key, written, FINITE).map(|mm| DVec3::from_array(mm) * MM);
            if written.is_none() {
                self.resolve.checks.missing(&key, "an edge of the image as [x, y, z]");
            }
            found
        };
        let (corner, across, down) =
            (vector("corner_mm", stroke.corner_mm)?, vector("across_mm", stroke.across_mm), vector("down_mm", stroke.down_mm));
        let (across, down) = (across?, down?);
        if across.length() * down.length() == 0.0 || across.normalize().dot(down.normalize()).abs() > SKEW {
            let accepted = "an edge longer than 0, at a right angle to across_mm";
            self.resolve.checks.not_accepted(&format!("{table}.down_mm"), accepted);
            return None;
        }
        Some(Laid::Flat { middle_map: corner + 0.5 * (across + down), right_map: 0.5 * across, up_map: -0.5 * down })
    }

    fn laid_around(&mut self, table: &str, stroke: &Stroke) -> Option<Laid> {
        let flat = [("across_mm", stroke.across_mm.is_some()), ("down_mm", stroke.down_mm.is_some())];
        self.leave_out(table, &flat, "beside center_mm");
        let center_map = self.resolve.checks.position(&format!("{table}.center_mm"), stroke.center_mm) * MM;
        let north_map = match stroke.axis {
            None => DVec3::Z,
            axis => self.resolve.direction(&format!("{table}.axis"), axis)?,
        };
        let front_key = format!("{table}.front");
        let front = match stroke.front {
            None => north_map.any_orthonormal_vector(),
            front => self.resolve.direction(&front_key, front)?,
        };
        let front_map = front.reject_from_normalized(north_map).try_normalize();
        if front_map.is_none_or(|_| front.dot(north_map).abs() > 1.0 - 1e-9) {
            self.resolve.checks.not_accepted(&front_key, "another direction than axis");
            return None;
        }
        Some(Laid::Around { center_map, north_map, front_map: front_map? })
    }

    fn file(&mut self, index: usize, stroke: &Stroke, ending: Option<&str>) -> Option<PathBuf> {
        let key = format!("stroke[{index}].file");
        let Some(file) = &stroke.file else {
            self.resolve.checks.missing(&key, "the file to write, relative to the working directory");
            return None;
        };
        let path = PathBuf::from(file);
        if let Some(ending) = ending
            && !path.extension().is_some_and(|found| found.eq_ignore_ascii_case(ending))
        {
            self.resolve.checks.not_accepted(&key, format_args!("a file whose name ends in .{ending}"));
            return None;
        }
        if let Some((first, _)) = self.written.iter().find(|(_, earlier)| *earlier == path) {
            let line = self.resolve.document.line(&format!("stroke[{first}]")).unwrap_or_default();
            self.resolve.checks.not_accepted(&key, format_args!("another file: the stroke in line {line} writes this one"));
            return None;
        }
        self.written.push((index, path.clone()));
        Some(path)
    }

    fn only_what_belongs(&mut self, table: &str, stroke: &Stroke, deed: Deed) {
        const SOLID: &[&str] = &["points", "mesh", "shape", "units", "spacing_mm", "position_mm", "orientation_xyzw", "sharp"];
        const LAID: &[&str] = &["image", "depth_mm", "corner_mm", "across_mm", "down_mm", "center_mm", "axis", "front"];
        let known: &[&str] = match deed {
            Deed::Take => &["tool", "brush_mm", "falloff", "color", "depth_mm", "image", "sharp"],
            Deed::Hold => &["until_s"],
            Deed::Union | Deed::Intersection | Deed::Difference => SOLID,
            Deed::Emboss | Deed::Engrave => LAID,
            Deed::Undo | Deed::Redo => &[],
            Deed::Region => &["region_mm"],
            Deed::SavePoints | Deed::SaveSession | Deed::Export => &["file"],
        };
        let given = [
            ("until_s", stroke.until_s.is_some()),
            ("tool", stroke.tool.is_some()),
            ("brush_mm", stroke.brush_mm.is_some()),
            ("falloff", stroke.falloff.is_some()),
            ("color", stroke.color.is_some()),
            ("depth_mm", stroke.depth_mm.is_some()),
            ("image", stroke.image.is_some()),
            ("sharp", stroke.sharp.is_some()),
            ("points", stroke.points.is_some()),
            ("mesh", stroke.mesh.is_some()),
            ("shape", stroke.shape.is_some()),
            ("units", stroke.units.is_some()),
            ("spacing_mm", stroke.spacing_mm.is_some()),
            ("position_mm", stroke.position_mm.is_some()),
            ("orientation_xyzw", stroke.orientation_xyzw.is_some()),
            ("corner_mm", stroke.corner_mm.is_some()),
            ("across_mm", stroke.across_mm.is_some()),
            ("down_mm", stroke.down_mm.is_some()),
            ("center_mm", stroke.center_mm.is_some()),
            ("axis", stroke.axis.is_some()),
            ("front", stroke.front.is_some()),
            ("region_mm", stroke.region_mm.is_some()),
            ("file", stroke.file.is_some()),
        ];
        let strange: Vec<(&str, bool)> = given.into_iter().filter(|(name, _)| !known.contains(name)).collect();
        let keys = if known.is_empty() { "no key beside at_s".to_owned() } else { known.join(", ") };
        self.leave_out(table, &strange, &format!("beside do = \"{deed}\", which takes {keys}"));
    }

    fn leave_out(&mut self, table: &str, keys: &[(&str, bool)], why: &str) {
        for (name, _) in keys.iter().filter(|(_, is_given)| *is_given) {
            self.resolve.checks.not_accepted(&format!("{table}.{name}"), format_args!("left out {why}"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sculpt::falloff::Falloff;
    use crate::sculpt::studio::Craft;

    fn read(text: &str) -> Result<Vec<Timed>, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("s.toml");
        fs::write(&path, format!("version = 1\n{text}")).unwrap();
        let mut pixels = tiny_skia::Pixmap::new(4, 4).unwrap();
        pixels.fill(tiny_skia::Color::WHITE);
        fs::write(folder.path().join("a.png"), pixels.encode_png().unwrap()).unwrap();
        fs::write(folder.path().join("bad.png"), "no image").unwrap();
        fs::write(folder.path().join("three.xyz"), "0 0 0\n1 0 0\n0 1 0\n").unwrap();
        load(&path, &ToolSettings::default())
            .map_err(|errors| errors.to_string().replace(&format!("{}/", folder.path().display()), ""))
    }

    #[test]
    fn strokes_come_in_the_order_of_their_times() {
        let orders = read(
            "[[stroke]]\nat_s = 2\ndo = \"undo\"\n\
             [[stroke]]\nat_s = 0.5\ndo = \"take\"\ntool = \"pull\"\nbrush_mm = 4\nfalloff = [1, 0.5, 0]\ncolor = \"#0102ff\"\n\
             [[stroke]]\nat_s = 1\ndo = \"hold\"\nuntil_s = 2\n\
             [[stroke]]\nat_s = 2\ndo = \"redo\"\n",
        )
        .unwrap();
        let seconds: Vec<f64> = orders.iter().map(|(at, _)| at.as_secs_f64()).collect();
        assert_eq!(seconds, [0.5, 1.0, 2.0, 2.0, 2.0]);
        let Order::Take(tool) = &orders[0].1 else { panic!("{orders:?}") };
        assert_eq!((tool.craft, tool.brush_m, tool.color), (Craft::Pull, 4e-3, [1, 2, 255]));
        assert_eq!(tool.falloff, Falloff::Table(vec![1.0, 0.5, 0.0]));
        assert_eq!(tool.depth_m, ToolSettings::default().depth_m);
        assert!(matches!(orders[1].1, Order::Hold(true)));
        assert!(
            matches!(orders[2].1, Order::Undo) && matches!(orders[3].1, Order::Hold(false)) && matches!(orders[4].1, Order::Redo)
        );
    }

    #[test]
    fn solids_are_sampled_where_they_stand() {
        let orders = read(
            "[[stroke]]\nat_s = 0\ndo = \"difference\"\nshape = { sphere_mm = 5 }\nspacing_mm = 1\nposition_mm = [10, 0, 0]\nsharp = true\n",
        )
        .unwrap();
        let Order::Combine { boolean: Boolean::Difference, with, is_sharp: true } = &orders[0].1 else { panic!("{orders:?}") };
        for (at, normal) in with.positions_map.iter().zip(&with.normals_map) {
            let way = *at - DVec3::X * 0.01;
            assert!((way.length() - 5e-3).abs() < 5e-5 && normal.dot(way.normalize()) > 0.98, "{at} {normal}");
        }
    }

    #[test]
    fn images_lie_as_their_edges_say() {
        let orders = read(
            "[[stroke]]\nat_s = 0\ndo = \"engrave\"\nimage = \"a.png\"\ndepth_mm = 2\ncorner_mm = [-5, 5, 1]\nacross_mm = [10, 0, 0]\n\
             down_mm = [0, -10, 0]\n\
             [[stroke]]\nat_s = 0\ndo = \"emboss\"\nimage = \"a.png\"\ncenter_mm = [0, 0, 7]\naxis = [0, 2, 0]\nfront = [1, 1, 0]\n",
        )
        .unwrap();
        let Order::Emboss { laid: Laid::Flat { middle_map, right_map, up_map }, depth_m, .. } = &orders[0].1 else {
            panic!("{orders:?}")
        };
        assert!((*depth_m + 2e-3).abs() < 1e-12);
        assert!(middle_map.distance(DVec3::Z * 1e-3) < 1e-12);
        assert!(right_map.distance(DVec3::X * 5e-3) < 1e-12 && up_map.distance(DVec3::Y * 5e-3) < 1e-12);
        let Order::Emboss { laid: Laid::Around { center_map, north_map, front_map }, depth_m, .. } = &orders[1].1 else {
            panic!("{orders:?}")
        };
        assert!((depth_m - 1e-3).abs() < 1e-12);
        assert_eq!((*north_map, *front_map), (DVec3::Y, DVec3::X));
        assert!(center_map.distance(DVec3::Z * 7e-3) < 1e-12);
    }

    #[test]
    fn every_mistake_is_named_with_its_line_and_what_would_do() {
        let cases = [
            ("[[strok]]\nat_s = 1", "s.toml:2: strok: unknown key; did you mean `stroke`?"),
            ("[[stroke]]\ndo = \"undo\"", "s.toml:2: stroke[0].at_s: missing; give a number: from 0 to 100000 s"),
            ("[[stroke]]\nat_s = -1\ndo = \"undo\"", "s.toml:3: stroke[0].at_s = -1: must be from 0 to 100000 s"),
            ("[[stroke]]\nat_s = 1", "stroke[0].do: missing; give \"take\", \"hold\", \"union\""),
            ("[[stroke]]\nat_s = 1\ndo = \"carve\"", "s.toml:4: stroke[0].do = \"carve\": must be \"take\", \"hold\""),
            ("[[stroke]]\nat_s = 1\ndo = \"undo\"\nfile = \"a\"", "left out beside do = \"undo\", which takes no key beside at_s"),
            ("[[stroke]]\nat_s = 1\ndo = \"take\"\ntool = \"pul\"", "did you mean `pull`?"),
            (
                "[[stroke]]\nat_s = 1\ndo = \"take\"\nbrush_mm = 0",
                "s.toml:5: stroke[0].brush_mm = 0: must be greater than 0 and at most 1000 mm",
            ),
            ("[[stroke]]\nat_s = 1\ndo = \"take\"\nfalloff = [1]", "falloff = [1]: a table of a fall-off needs at least 2 weights"),
            ("[[stroke]]\nat_s = 1\ndo = \"take\"\ncolor = \"red\"", "color = \"red\": must be a colour as \"#rrggbb\""),
            ("[[stroke]]\nat_s = 1\ndo = \"take\"\nimage = \"b.png\"", "image = \"b.png\": no such file: b.png"),
            ("[[stroke]]\nat_s = 1\ndo = \"take\"\nimage = \"bad.png\"", "bad.png is no PNG image that can be read"),
            ("[[stroke]]\nat_s = 1\ndo = \"hold\"", "stroke[0].until_s: missing"),
            ("[[stroke]]\nat_s = 1\ndo = \"hold\"\nuntil_s = 1", "until_s = 1: must be later than at_s = 1 s"),
            (
                "[[stroke]]\nat_s = 1\ndo = \"hold\"\nuntil_s = 3\n[[stroke]]\nat_s = 2\ndo = \"hold\"\nuntil_s = 4",
                "s.toml:7: stroke[1].at_s = 2: must be 3 s or later: until then the tool is held by the stroke in line 2",
            ),
            (
                "[[stroke]]\nat_s = 2\ndo = \"hold\"\nuntil_s = 3\n[[stroke]]\nat_s = 1\ndo = \"hold\"\nuntil_s = 2",
                "s.toml:3: stroke[0].at_s = 2: must be later than 2 s, or stand below the stroke in line 6",
            ),
            ("[[stroke]]\nat_s = 1\ndo = \"union\"", "stroke[0].points: missing; give points, a mesh, a shape such as"),
            (
                "[[stroke]]\nat_s = 1\ndo = \"union\"\nmesh = \"a.obj\"\nshape = { sphere_mm = 1 }",
                "cannot stand beside stroke[0].mesh",
            ),
            ("[[stroke]]\nat_s = 1\ndo = \"union\"\npoints = \"three.xyz\"", "stroke[0].units: missing"),
            (
                "[[stroke]]\nat_s = 1\ndo = \"union\"\npoints = \"three.xyz\"\nunits = \"mm\"",
                "three.xyz: 3 points, at least 32 are needed",
            ),
            ("[[stroke]]\nat_s = 1\ndo = \"union\"\nshape = { sphere_mm = 10 }\nspacing_mm = 0.001", "the shape: a spacing of"),
            ("[[stroke]]\nat_s = 1\ndo = \"emboss\"\nimage = \"a.png\"", "stroke[0].corner_mm: missing"),
            ("[[stroke]]\nat_s = 1\ndo = \"emboss\"\ncenter_mm = [0, 0, 0]", "stroke[0].image: missing; give a PNG file"),
            (
                "[[stroke]]\nat_s = 1\ndo = \"emboss\"\nimage = \"a.png\"\ncorner_mm = [0, 0, 0]\nacross_mm = [1, 0, 0]\ndown_mm = [1, 1, 0]",
                "at a right angle to across_mm",
            ),
            (
                "[[stroke]]\nat_s = 1\ndo = \"emboss\"\nimage = \"a.png\"\ncenter_mm = [0, 0, 0]\naxis = [0, 0, 1]\nfront = [0, 0, 1]",
                "front = [0, 0, 1]: must be another direction than axis",
            ),
            ("[[stroke]]\nat_s = 1\ndo = \"region\"", "stroke[0].region_mm: missing"),
            ("[[stroke]]\nat_s = 1\ndo = \"region\"\nregion_mm = [[0, 0, 0], [1, 0, 1]]", "the lowest corner first"),
            ("[[stroke]]\nat_s = 1\ndo = \"export\"", "stroke[0].file: missing"),
            ("[[stroke]]\nat_s = 1\ndo = \"export\"\nfile = \"a.obj\"", "must be a file whose name ends in .ply"),
            (
                "[[stroke]]\nat_s = 1\ndo = \"export\"\nfile = \"a.ply\"\n[[stroke]]\nat_s = 2\ndo = \"save-points\"\nfile = \"a.ply\"",
                "the stroke in line 2 writes this one",
            ),
        ];
        for (text, expected) in cases {
            let message = read(text).unwrap_err();
            assert!(message.contains(expected), "{text}\n--- said\n{message}\n--- not\n{expected}");
        }
    }
}
