//! What was built of a part, in the words of `hapticd bake --json`.

use std::borrow::Cow;

use crate::mesh::validate::{FACES_INWARD, MeshReport};
use crate::pointshell::{LevelReport, ShellReport};
use crate::solid::SolidReport;
use crate::voxmap::accuracy::Accuracy;
use crate::voxmap::inside_test::InsideBasis;
use crate::voxmap::{MOSTLY_THIN, Volume};

/// What the cache did for an object.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "lowercase")
)]
pub enum CacheUse {
    /// Not asked.
    #[default]
    Off,
    /// Nothing was baked.
    Hit,
    /// Baked, as there was no file.
    Miss,
    /// Baked, as the file was damaged or of another version.
    Rebaked,
}

/// What an object is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "lowercase")
)]
pub enum PartRole {
    /// One voxmap of a scene.
    Static,
    /// The pointshell of a scene.
    Tool,
    /// A mesh on its own: both.
    Mesh,
}

/// Where the fill got in.
#[derive(Clone, Copy, Debug)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct LeakReport {
    /// Centre of the widest hole, mesh frame, m.
    pub position_m: [f64; 3],
    /// Its width, m, however long it is.
    pub size_m: f64,
}

/// Lids that close the holes of a mesh.
#[derive(Clone, Copy, Debug)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct HoleCapsReport {
    /// Connected lids.
    pub count: usize,
    /// Their area, m².
    pub area_m2: f64,
}

/// What the triangles of an object were taken for.
#[derive(Clone, Debug)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SolidFigures {
    /// Connected pieces.
    pub pieces: usize,
    /// Closed pieces that are material inside.
    pub bodies: usize,
    /// Volumes of closed pieces that are empty inside of bodies, m³.
    pub cavities_m3: Vec<f64>,
    /// Pieces that are not closed.
    pub open_pieces: usize,
    /// Parts made of these that enclose nothing and are two-sided skins.
    pub skins: usize,
    /// Area of the skins, m².
    pub skin_area_m2: f64,
    /// Area inside of the solid, left out, m².
    pub inside_area_m2: f64,
    /// Closed pieces that faced the wrong way and were turned.
    pub turned_pieces: usize,
    /// Volume of the solid, with lids on holes where it has them, m³; 0 where nothing has an inside.
    pub volume_m3: f64,
}

impl SolidFigures {
    fn new(solid: &SolidReport, map: &Volume) -> Self {
        let skins = map.beside.iter().filter(|beside| beside.map.thin);
        Self {
            pieces: solid.pieces,
            bodies: solid.bodies,
            cavities_m3: solid.cavities.iter().map(|cavity| cavity.volume_m3).collect(),
            open_pieces: solid.open_pieces,
            skins: skins.clone().count() + usize::from(map.thin),
            skin_area_m2: if map.thin {
                solid.open_area_m2
            } else {
                skins.fold(0.0, |sum, beside| sum + beside.area_m2)
            },
            inside_area_m2: solid.inside_area_m2,
            turned_pieces: solid.turned_pieces,
            volume_m3: map.mass.map_or(0.0, |mass| mass.volume_m3),
        }
    }
}

/// Seconds per stage of this run; 0 for a stage that the role does not need, and for all but `load`
/// when the cache had the object.
#[derive(Clone, Copy, Debug, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Timings {
    /// Reading or tessellating, and inspecting; or finding and reading the object in the cache.
    pub load: f64,
    /// What the triangles mean, and grid set-up.
    pub init: f64,
    /// Navigation and SAT.
    pub surface: f64,
    /// Flood fill, leak search, lids, orientation.
    pub fill: f64,
    /// Layers.
    pub layers: f64,
    /// Distances and field.
    pub distance: f64,
    /// Projection and layout of points.
    pub pointshell: f64,
    /// Normals.
    pub normals: f64,
    /// Order of the points and the tree over them.
    pub tree: f64,
    /// From the mesh file to the baked object.
    pub total: f64,
}

/// One object's figures.
#[derive(Clone, Debug)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ObjectReport {
    /// Name in the scene, or the file name.
    pub name: String,
    /// Obstacle, tool or both.
    pub role: PartRole,
    /// Triangles of the mesh, without lids.
    pub triangles: usize,
    /// Voxel edge s, m.
    pub voxel_size_m: f64,
    /// Lowest corner of cell `[0, 0, 0]`, mesh frame, m.
    pub origin_m: [f64; 3],
    /// Voxels per axis.
    pub dims: [u32; 3],
    /// Voxels in the box.
    pub voxels: u64,
    /// Voxels that the surface touches, lids included.
    pub surface_voxels: u64,
    /// Voxels that the fill did not reach.
    pub inside_voxels: u64,
    /// Voxels that the fill reached.
    pub outside_voxels: u64,
    /// Layers on each side.
    pub layers: u32,
    /// The fill did not leak.
    pub watertight: bool,
    /// What the triangles were taken for; `None` where they were taken as they are.
    pub solid: Option<SolidFigures>,
    /// `flood`: a solid by the fill; `winding`: by the fill with lids on the holes; `thin`: a
    /// two-sided skin.
    pub sides: Cow<'static, str>,
    /// Share of the places beside the surface whose winding number is within 0.1 of a whole number;
    /// `None` where it was not measured.
    pub clear_winding_share: Option<f64>,
    /// Lids on its holes, where there are any.
    pub lids: Option<HoleCapsReport>,
    /// Where it leaked; `None`: it did not.
    pub leak: Option<LeakReport>,
    /// Edges with one triangle only, after welding.
    pub open_edges: usize,
    /// How candidates were walked.
    pub navigation: Cow<'static, str>,
    /// SAT tests spent.
    pub sat_tests: u64,
    /// Points of the shell; 0 for a static object.
    pub points: usize,
    /// Points found in phase 1.
    pub phase1_points: usize,
    /// Points found in phase 2.
    pub phase2_points: usize,
    /// Levels of the point-sphere tree, from coarse to fine; the last holds all points. Empty for a
    /// static object.
    pub tree_levels: Vec<LevelReport>,
    /// What the bake cache did.
    pub cache: CacheUse,
    /// Threads of this run.
    pub threads: usize,
    /// Seconds per stage.
    pub timings_s: Timings,
    /// What it tells apart.
    pub accuracy: Accuracy,
    /// What a user should know.
    pub warnings: Vec<String>,
}

impl ObjectReport {
    pub(crate) fn new(
        name: &str,
        role: PartRole,
        mesh: &MeshReport,
        mut warnings: Vec<String>,
        map: &Volume,
        shell: &ShellReport,
        load_s: f64,
    ) -> Self {
        let grid = &map.surface.grid;
        let inside_voxels = map.sides.count_inside(&map.surface);
        let surface_voxels = map.surface.n_voxels as u64;
        if let Some(leak) = map.leak {
            let [x, y, z] = (leak.position_m * 1e3).to_array();
            let what = what_was_done(map);
            warnings.push(format!(
                "the surface leaks near ({x:.2}, {y:.2}, {z:.2}) mm through a hole of about {:.2} \
                    mm: {what}",
                leak.size_m * 1e3
            ));
        }
        let solid = map.solid.as_ref().map(|solid| SolidFigures::new(solid, map));
        let is_border = map.solid.as_ref().is_some_and(|solid| solid.bodies > 0);
        if is_border && map.beside.is_empty() {
            warnings.extend(map.mass.and_then(|mass| {
                other_volume(mass.volume_m3, inside_voxels, surface_voxels, grid.voxel_size_m)
            }));
        }
        if map.basis != InsideBasis::Thin && inside_voxels == 0 && !is_border {
            warnings
                .push("nothing is inside, so it will not be felt; a thin skin would be".to_owned());
        }
        if map.leak.is_none() && map.thin && map.thin_share > MOSTLY_THIN {
            warnings.push(
                "thinner than its voxels resolve: it is treated as a two-sided skin of one voxel; \
                    a solid needs voxels of less than half its thickness"
                    .to_owned(),
            );
        }
        if map.orientation.n_inverted > 0 {
            // Says the same, and more.
            warnings.retain(|warning| warning != FACES_INWARD);
            warnings.push(format!(
                "{} triangles face inward; their side was taken from the fill",
                map.orientation.n_inverted
            ));
        }
        if let Some(SolidFigures { skins: n @ 1.., skin_area_m2, .. }) = &solid
            && !map.thin
        {
            let skins = if *n == 1 { "1 skin".to_owned() } else { format!("{n} skins") };
            let area_mm2 = skin_area_m2 * 1e6;
            warnings.push(format!(
                "{skins} beside the solid, {area_mm2:.1} mm²: felt as plates of two voxels"
            ));
        }
        let stages = map.timings;
        let mut timings_s = Timings {
            load: load_s,
            init: stages.init_s,
            surface: stages.surface_s,
            fill: stages.fill_s,
            layers: stages.layers_s,
            distance: stages.distance_s,
            pointshell: shell.project_s,
            normals: shell.normals_s,
            tree: shell.tree_s,
            total: 0.0,
        };
        let Timings {
            load,
            init,
            surface,
            fill,
            layers,
            distance,
            pointshell,
            normals,
            tree,
            total: _,
        } = timings_s;
        timings_s.total =
            load + init + surface + fill + layers + distance + pointshell + normals + tree;
        Self {
            name: name.to_owned(),
            role,
            triangles: mesh.triangles,
            voxel_size_m: grid.voxel_size_m,
            origin_m: grid.origin_m.to_array(),
            dims: grid.dims,
            voxels: grid.n_cells(),
            surface_voxels,
            inside_voxels,
            outside_voxels: grid.n_cells() - surface_voxels - inside_voxels,
            layers: map.layers.n_layers,
            watertight: map.watertight,
            solid,
            sides: map.basis.name().into(),
            clear_winding_share: map.clear_share,
            lids: map
                .capped
                .as_ref()
                .map(|capped| HoleCapsReport { count: capped.n_lids, area_m2: capped.area_m2 }),
            leak: map.leak.map(|leak| LeakReport {
                position_m: leak.position_m.to_array(),
                size_m: leak.size_m,
            }),
            open_edges: mesh.open_edges,
            navigation: map.surface.navigation.name().into(),
            sat_tests: map.surface.sat_tests,
            points: shell.points,
            phase1_points: shell.phase1_points,
            phase2_points: shell.phase2_points,
            tree_levels: shell.tree_levels.clone(),
            cache: CacheUse::Off,
            threads: rayon::current_num_threads(),
            timings_s,
            accuracy: Accuracy::default(),
            warnings,
        }
    }
}

/// Of the volume, the triangles and the voxels may differ by this part.
const VOLUME_SHARE: f64 = 0.02;

/// What to say of a volume by triangles that is not between that of the voxels inside and that of
/// these and of those at the surface: the first lie in the solid, and no others do. However thin a
/// part is, its volume is between them.
fn other_volume(volume_m3: f64, inside: u64, surface: u64, voxel_size_m: f64) -> Option<String> {
    let voxels_mm3 = |n: u64| n as f64 * (1e3 * voxel_size_m).powi(3);
    let least_mm3 = voxels_mm3(inside);
    let most_mm3 = voxels_mm3(inside + surface);
    let volume_mm3 = 1e9 * volume_m3;
    let is_between = volume_mm3 >= (1.0 - VOLUME_SHARE) * least_mm3
        && volume_mm3 <= (1.0 + VOLUME_SHARE) * most_mm3;
    (!is_between).then(|| {
        format!(
            "its triangles bound {volume_mm3:.1} mm³, its voxels between {least_mm3:.1} and \
                {most_mm3:.1} mm³: mass or forces are wrong; cut away what stands twice or passes \
                through itself"
        )
    })
}

/// What became of an object whose fill leaks.
fn what_was_done(map: &Volume) -> String {
    let clear = map
        .clear_share
        .map(|share| format!("{:.0} % of samples", 100.0 * share))
        .unwrap_or_default();
    match (map.basis, &map.capped) {
        (InsideBasis::Flood, _) => "only what the fill left inside is solid".to_owned(),
        (InsideBasis::Winding, Some(capped)) => {
            let lids = if capped.n_lids == 1 {
                "1 lid closes".to_owned()
            } else {
                format!("{} lids close", capped.n_lids)
            };
            let area_mm2 = capped.area_m2 * 1e6;
            format!(
                "sides were taken from winding numbers, clear at {clear}, and {lids} the holes \
                    ({area_mm2:.1} mm²)"
            )
        }
        (InsideBasis::Winding, None) => {
            format!("winding numbers, clear at {clear}, found nothing to close")
        }
        (InsideBasis::Thin, _) if map.clear_share.is_some() => {
            format!(
                "it is treated as a thin two-sided skin, because winding numbers are clear at \
                    {clear} only"
            )
        }
        (InsideBasis::Thin, _) => "it is treated as a thin two-sided skin".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_volume_that_its_voxels_cannot_have_is_said() {
        // 1000 voxels of 1 mm inside, 500 at the surface.
        for (volume_mm3, is_said) in
            [(970.0, true), (985.0, false), (1250.0, false), (1520.0, false), (1540.0, true)]
        {
            let said = other_volume(volume_mm3 * 1e-9, 1000, 500, 1e-3);
            assert_eq!(said.is_some(), is_said, "{volume_mm3}");
        }
        // A sheet has nothing inside.
        assert_eq!(other_volume(1e-12, 0, 500, 1e-3), None);
    }
}
