use std::fs;

use glam::DVec3;

use super::*;
use clay::emboss::ImagePlacement;
use clay::engine::SculptTool;
use clay::falloff::Falloff;
use clay::material_map::{MaterialPlace, Painted};

fn read(text: &str) -> Result<Vec<TimedOrder>, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.toml");
    fs::write(&path, format!("version = 1\n{text}")).unwrap();
    let mut pixels = tiny_skia::Pixmap::new(4, 4).unwrap();
    pixels.fill(tiny_skia::Color::WHITE);
    fs::write(folder.path().join("a.png"), pixels.encode_png().unwrap()).unwrap();
    fs::write(folder.path().join("bad.png"), "no image").unwrap();
    fs::write(folder.path().join("three.xyz"), "0 0 0\n1 0 0\n0 1 0\n").unwrap();
    load(&path, &ToolSettings::default())
        .map(|script| script.orders)
        .map_err(|errors| errors.to_string().replace(&format!("{}/", folder.path().display()), ""))
}

#[test]
fn strokes_come_in_the_order_of_their_times() {
    let orders = read(
        "[[stroke]]\nat_s = 2\ndo = \"undo\"\n[[stroke]]\nat_s = 0.5\ndo = \"take\"\ntool = \
            \"pull\"\nbrush_mm = 4\nfalloff = [1, 0.5, 0]\ncolor = \"#0102ff\"\n[[stroke]]\nat_s = \
            1\ndo = \"hold\"\nuntil_s = 2\n[[stroke]]\nat_s = 2\ndo = \"redo\"\n",
    )
    .unwrap();
    let seconds: Vec<f64> = orders.iter().map(|timed| timed.at.as_secs_f64()).collect();
    assert_eq!(seconds, [0.5, 1.0, 2.0, 2.0, 2.0]);
    let SculptOrder::Take(tool) = &orders[0].order else { panic!("{orders:?}") };
    assert_eq!((tool.kind, tool.brush_m, tool.color), (SculptTool::Pull, 4e-3, [1, 2, 255]));
    assert_eq!(tool.falloff, Falloff::Table(vec![1.0, 0.5, 0.0]));
    assert_eq!(tool.depth_m, ToolSettings::default().depth_m);
    assert!(matches!(orders[1].order, SculptOrder::Hold(true)));
    assert!(
        matches!(orders[2].order, SculptOrder::Undo)
            && matches!(orders[3].order, SculptOrder::Hold(false))
            && matches!(orders[4].order, SculptOrder::Redo)
    );
}

#[test]
fn a_material_is_taken_as_a_whole_and_stays_where_none_is_written() {
    let painted = |written: &str| {
        let orders =
            read(&format!("[[stroke]]\nat_s = 0\ndo = \"take\"\ntool = \"material\"\n{written}\n"))
                .unwrap();
        let SculptOrder::Take(tool) = &orders[0].order else { panic!("{orders:?}") };
        assert_eq!(tool.kind, SculptTool::Material);
        tool.painted
    };
    let stiff = Painted { stiffness_n_per_m: Some(300.0), ..Painted::default() };
    assert_eq!(painted("painted = { stiffness = 300 }"), stiff);
    assert_eq!(painted("painted = { mass = 1e-3, damping = 0 }").damping_n_s_per_m, Some(0.0));
    assert_eq!([painted("painted = {}"), painted("")], [Painted::default(); 2]);
}

#[test]
fn solids_are_sampled_where_they_stand() {
    let orders = read(
        "[[stroke]]\nat_s = 0\ndo = \"difference\"\nshape = { sphere_mm = 5 }\nspacing_mm = \
            1\nposition_mm = [10, 0, 0]\nsharp = true\n",
    )
    .unwrap();
    let SculptOrder::Combine { boolean: Boolean::Difference, with, map_from_body, is_sharp: true } =
        &orders[0].order
    else {
        panic!("{orders:?}")
    };
    let with = with.beside(1.0, &clay::WorkMeter::unlimited()).unwrap().placed(map_from_body);
    for (at, normal) in with.positions_map.iter().zip(&with.normals_map) {
        let way = *at - DVec3::X * 0.01;
        assert!(
            (way.length() - 5e-3).abs() < 5e-5 && normal.dot(way.normalize()) > 0.98,
            "{at} {normal}"
        );
    }
}

#[test]
fn images_lie_as_their_edges_say() {
    let orders = read(
        "[[stroke]]\nat_s = 0\ndo = \"engrave\"\nimage = \"a.png\"\ndepth_mm = 2\ncorner_mm = [-5, \
            5, 1]\nacross_mm = [10, 0, 0]\ndown_mm = [0, -10, 0]\n[[stroke]]\nat_s = 0\ndo = \
            \"emboss\"\nimage = \"a.png\"\ncenter_mm = [0, 0, 7]\naxis = [0, 2, 0]\nfront = [1, 1, \
            0]\n",
    )
    .unwrap();
    let SculptOrder::Emboss {
        placement: ImagePlacement::Flat { middle_map, right_map, up_map },
        depth_m,
        ..
    } = &orders[0].order
    else {
        panic!("{orders:?}")
    };
    assert!((*depth_m + 2e-3).abs() < 1e-12);
    assert!(middle_map.distance(DVec3::Z * 1e-3) < 1e-12);
    assert!(
        right_map.distance(DVec3::X * 5e-3) < 1e-12 && up_map.distance(DVec3::Y * 5e-3) < 1e-12
    );
    let SculptOrder::Emboss {
        placement: ImagePlacement::Around { center_map, north_map, front_map },
        depth_m,
        ..
    } = &orders[1].order
    else {
        panic!("{orders:?}")
    };
    assert!((depth_m - 1e-3).abs() < 1e-12);
    assert_eq!((*north_map, *front_map), (DVec3::Y, DVec3::X));
    assert!(center_map.distance(DVec3::Z * 7e-3) < 1e-12);
}

#[test]
fn material_is_laid_by_a_place_or_by_a_file_of_values() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.toml");
    let values = |text: &str| fs::write(folder.path().join("v.csv"), text).unwrap();
    let laid = |keys: &str| {
        fs::write(&path, format!("version = 1\n[[stroke]]\nat_s = 1\ndo = \"lay\"\n{keys}\n"))
            .unwrap();
        match load(&path, &ToolSettings::default()) {
            Ok(script) => match script.orders[0].order.clone() {
                SculptOrder::Lay { painted, place } => Ok((painted, place)),
                other => panic!("{other:?}"),
            },
            Err(errors) => {
                Err(errors.problems().iter().map(Problem::to_string).collect::<String>())
            }
        }
    };
    let hard = "painted = { stiffness = 500 }\n";
    let (painted, place) = laid(hard).unwrap();
    assert_eq!((painted.stiffness_n_per_m, place), (Some(500.0), MaterialPlace::Everywhere));
    let (_, place) = laid(&format!("{hard}low_mm = [0, 0, 0]\nhigh_mm = [1, 2, 3]")).unwrap();
    assert!(
        matches!(place, MaterialPlace::Box { low_map: DVec3::ZERO, high_map } if (high_map.z - 3e-3).abs() < 1e-12)
    );
    let (_, place) = laid(&format!("{hard}center_mm = [0, 0, 0]\nradius_mm = 2")).unwrap();
    assert!(
        matches!(place, MaterialPlace::Ball { radius_m, falloff: Falloff::Constant, .. } if (radius_m - 2e-3).abs() < 1e-12)
    );
    values("x_mm,y_mm,z_mm,mass,damping,stiffness\n1,2,3,,,700\n\n4,5,6,1e-3,2,\n");
    let (_, place) = laid("values = \"v.csv\"\nwithin_mm = 4").unwrap();
    let MaterialPlace::Values { places_map, painted, within_m } = place else {
        panic!("{place:?}")
    };
    assert!(
        places_map.len() == 2
            && (places_map[1].z - 6e-3).abs() < 1e-12
            && (within_m - 4e-3).abs() < 1e-12
    );
    assert_eq!(
        (painted[0].stiffness_n_per_m, painted[0].mass_kg, painted[1].mass_kg),
        (Some(700.0), None, Some(1e-3))
    );
    for (keys, expected) in [
        ("low_mm = [0, 0, 0]", "high_mm: missing"),
        ("low_mm = [0, 0, 0]\nhigh_mm = [1, 0, 1]", "higher than low_mm"),
        ("low_mm = [0, 0, 0]\nhigh_mm = [1, 1, 1]\nradius_mm = 2", "radius_mm"),
        ("from_mm = [0, 0, 0]\nto_mm = [0, 0, 0]", "another place than from_mm"),
        ("values = \"none.csv\"", "no such file"),
        ("values = \"v.csv\"\npainted = { mass = 1e-3 }", "beside values"),
    ] {
        let said = laid(keys).unwrap_err();
        assert!(said.contains(expected), "{keys}: {said}");
    }
    for (text, expected) in [
        ("x,y,z\n1,2,3\n", "the first line is not"),
        ("x_mm,y_mm,z_mm,mass,damping,stiffness\n1,2\n", "line 2: `1,2` is not"),
        ("x_mm,y_mm,z_mm,mass,damping,stiffness\n1,2,3,5,,\n", "line 2: a mass of 5 kg"),
        ("x_mm,y_mm,z_mm,mass,damping,stiffness\n", "has no place"),
    ] {
        values(text);
        let said = laid("values = \"v.csv\"").unwrap_err();
        assert!(said.contains(expected), "{text}: {said}");
    }
}

#[test]
fn every_mistake_is_named_with_its_line_and_what_would_do() {
    let cases = [
        ("[[strok]]\nat_s = 1", "s.toml:2: strok: unknown key; did you mean `stroke`?"),
        (
            "[[stroke]]\ndo = \"undo\"",
            "s.toml:2: stroke (line 2): at_s: missing; give a number: from 0 to 100000 s",
        ),
        (
            "[[stroke]]\nat_s = -1\ndo = \"undo\"",
            "s.toml:3: stroke (line 2): at_s = -1: must be from 0 to 100000 s",
        ),
        (
            "[[stroke]]\nat_s = 1",
            "stroke at 1 s (line 2): do: missing; give \"take\", \"hold\", \"union\"",
        ),
        (
            "[[stroke]]\nat_s = 1\ndo = \"carve\"",
            "s.toml:4: stroke at 1 s (line 2): do = \"carve\": must be \"take\", \"hold\"",
        ),
        (
            "[[stroke]]\nat_s = 1\ndo = \"undo\"\nfile = \"a\"",
            "left out beside do = \"undo\", which takes no key beside at_s",
        ),
        ("[[stroke]]\nat_s = 1\ndo = \"take\"\ntool = \"pul\"", "did you mean `pull`?"),
        (
            "[[stroke]]\nat_s = 1\ndo = \"take\"\nbrush_mm = 0",
            "s.toml:5: stroke at 1 s (line 2): brush_mm = 0: must be greater than 0 and at most \
                1000 mm",
        ),
        (
            "[[stroke]]\nat_s = 1\ndo = \"take\"\nfalloff = { rate = 0 }",
            "the rate of a fall-off is 0; a rate is a number from 0.1 to 100",
        ),
        (
            "[[stroke]]\nat_s = 1\ndo = \"take\"\nfalloff = [1]",
            "falloff = [1]: a table of a fall-off needs at least 2 weights",
        ),
        (
            "[[stroke]]\nat_s = 1\ndo = \"take\"\ncolor = \"red\"",
            "color = \"red\": must be a colour as \"#rrggbb\"",
        ),
        (
            "[[stroke]]\nat_s = 1\ndo = \"take\"\npainted = { damping = 1e5 }",
            "s.toml:5: stroke at 1 s (line 2): painted.damping = 1e5: must be from 0 to 10000 N·s/m",
        ),
        (
            "[[stroke]]\nat_s = 1\ndo = \"hold\"\nuntil_s = 2\npainted = {}",
            "left out beside do = \"hold\", which takes until_s",
        ),
        (
            "[[stroke]]\nat_s = 1\ndo = \"take\"\nimage = \"b.png\"",
            "image = \"b.png\": no such file: b.png",
        ),
        (
            "[[stroke]]\nat_s = 1\ndo = \"take\"\nimage = \"bad.png\"",
            "bad.png is no PNG image that can be read",
        ),
        ("[[stroke]]\nat_s = 1\ndo = \"hold\"", "stroke at 1 s (line 2): until_s: missing"),
        (
            "[[stroke]]\nat_s = 1\ndo = \"hold\"\nuntil_s = 1",
            "until_s = 1: must be later than at_s = 1 s",
        ),
        (
            "[[stroke]]\nat_s = 1\ndo = \"hold\"\nuntil_s = 3\n[[stroke]]\nat_s = 2\ndo = \
                \"hold\"\nuntil_s = 4",
            "s.toml:7: stroke (line 6): at_s = 2: must be 3 s or later: until then the stroke in \
                line 2 holds or pulls",
        ),
        (
            "[[stroke]]\nat_s = 2\ndo = \"hold\"\nuntil_s = 3\n[[stroke]]\nat_s = 1\ndo = \
                \"hold\"\nuntil_s = 2",
            "s.toml:3: stroke (line 2): at_s = 2: must be later than 2 s, or stand below the \
                stroke in line 6",
        ),
        (
            "[[stroke]]\nat_s = 1\ndo = \"union\"",
            "stroke at 1 s (line 2): points: missing; give points, a mesh, a shape such as",
        ),
        (
            "[[stroke]]\nat_s = 1\ndo = \"union\"\nmesh = \"a.obj\"\nshape = { sphere_mm = 1 }",
            "cannot stand beside mesh;",
        ),
        (
            "[[stroke]]\nat_s = 1\ndo = \"union\"\npoints = \"three.xyz\"",
            "stroke at 1 s (line 2): units: missing",
        ),
        (
            "[[stroke]]\nat_s = 1\ndo = \"union\"\npoints = \"three.xyz\"\nunits = \"mm\"",
            "three.xyz: 3 points, at least 32 are needed",
        ),
        (
            "[[stroke]]\nat_s = 1\ndo = \"union\"\nshape = { sphere_mm = 10 }\nspacing_mm = 0.001",
            "the shape: it is 20 mm across, and a spacing of 1 µm makes too many points",
        ),
        (
            "[[stroke]]\nat_s = 1\ndo = \"emboss\"\nimage = \"a.png\"",
            "stroke at 1 s (line 2): corner_mm: missing",
        ),
        (
            "[[stroke]]\nat_s = 1\ndo = \"emboss\"\ncenter_mm = [0, 0, 0]",
            "stroke at 1 s (line 2): image: missing; give a PNG file",
        ),
        (
            "[[stroke]]\nat_s = 1\ndo = \"emboss\"\nimage = \"a.png\"\ncorner_mm = [0, 0, \
                0]\nacross_mm = [1, 0, 0]\ndown_mm = [1, 1, 0]",
            "at a right angle to across_mm",
        ),
        (
            "[[stroke]]\nat_s = 1\ndo = \"emboss\"\nimage = \"a.png\"\ncenter_mm = [0, 0, 0]\naxis \
                = [0, 0, 1]\nfront = [0, 0, 1]",
            "front = [0, 0, 1]: must be another direction than axis",
        ),
        ("[[stroke]]\nat_s = 1\ndo = \"region\"", "stroke at 1 s (line 2): region_mm: missing"),
        (
            "[[stroke]]\nat_s = 1\ndo = \"region\"\nregion_mm = [[0, 0, 0], [1, 0, 1]]",
            "the lowest corner first",
        ),
        (
            "[[stroke]]\nat_s = 1\ndo = \"draw\"",
            "curves_mm: missing; give curves, each a list of places",
        ),
        (
            "[[stroke]]\nat_s = 1\ndo = \"draw\"\ncurves_mm = [[]]",
            "must be 1 to 64 curves of at least one place each",
        ),
        ("[[stroke]]\nat_s = 1\ndo = \"draw\"\ncurves_mm = [[[0, 0]]]", "curves_mm"),
        (
            "[[stroke]]\nat_s = 1\ndo = \"pull\"\ncurves_mm = [[[0, 0, 1]]]\nforce_n = [0, 0, \
                0]\nuntil_s = 2",
            "force_n = [0, 0, 0]: must be a force above 0 and of 1000 N at most",
        ),
        (
            "[[stroke]]\nat_s = 1\ndo = \"pull\"\ncurves_mm = [[[0, 0, 1]]]\nforce_n = [0, 0, \
                1]\nuntil_s = 1",
            "until_s = 1: must be later than at_s = 1 s, by 60 s at most",
        ),
        (
            "[[stroke]]\nat_s = 1\ndo = \"pull\"\ncurves_mm = [[[0, 0, 1]]]\nuntil_s = 2",
            "force_n: missing",
        ),
        (
            "[[stroke]]\nat_s = 1\ndo = \"pull\"\ncurves_mm = [[[0, 0, 1]]]\nforce_n = [0, 0, \
                1]\nuntil_s = 2\n[[stroke]]\nat_s = 1.5\ndo = \"pull\"\ncurves_mm = [[[0, 0, \
                1]]]\nforce_n = [0, 0, 1]\nuntil_s = 3",
            "at_s = 1.5: must be 2 s or later: until then the stroke in line 2 holds or pulls",
        ),
        ("[[stroke]]\nat_s = 1\ndo = \"export\"", "stroke at 1 s (line 2): file: missing"),
        (
            "[[stroke]]\nat_s = 1\ndo = \"export\"\nfile = \"a.obj\"",
            "must be a file whose name ends in .ply",
        ),
        (
            "[[stroke]]\nat_s = 1\ndo = \"export\"\nfile = \"a.ply\"\n[[stroke]]\nat_s = 2\ndo = \
                \"save-points\"\nfile = \"a.ply\"",
            "the stroke in line 2 writes this one",
        ),
    ];
    for (text, expected) in cases {
        let message = read(text).unwrap_err();
        assert!(message.contains(expected), "{text}\n--- said\n{message}\n--- not\n{expected}");
    }
}

#[test]
fn solids_of_a_wrong_unit_are_distinguished_from_those_that_fit_a_clay_model() {
    let model = (DVec3::splat(-0.018), DVec3::splat(0.018));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.toml");
    let corner = "v 0 0 0\nv 10 0 0\nv 0 10 0\nv 0 0 10\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
    fs::write(folder.path().join("corner.obj"), corner).unwrap();
    let fitted = |text: &str| {
        fs::write(&path, format!("version = 1\n[[stroke]]\nat_s = 1\n{text}\n")).unwrap();
        let script = load(&path, &ToolSettings::default()).unwrap();
        let reported =
            |problems: &[Problem]| problems.iter().map(Problem::to_string).collect::<String>();
        script.fit(model).map(|odd| reported(&odd)).map_err(|errors| reported(errors.problems()))
    };
    assert_eq!(fitted("do = \"union\"\nmesh = \"corner.obj\"\nunits = \"mm\""), Ok(String::new()));
    let wrong = fitted("do = \"union\"\nmesh = \"corner.obj\"\nunits = \"m\"").unwrap_err();
    let expected = "s.toml:6: stroke at 1 s (line 2): units = \"m\": the solid is 10 m across, the clay \
        36 mm; is this unit right, and that of the clay?";
    assert!(wrong.ends_with(expected), "{wrong}");
    let wrong = fitted("do = \"difference\"\nshape = { sphere_mm = 0.1 }").unwrap_err();
    assert!(
        wrong.contains("s.toml:5:")
            && wrong.contains("0.2 mm across, the clay 36 mm; shapes are in mm"),
        "{wrong}"
    );
    let odd = fitted("do = \"union\"\nshape = { box_mm = [2, 2, 2] }\nposition_mm = [100, 0, 0]")
        .unwrap();
    assert!(
        odd.contains("the solid stands 81 mm away from the clay, which is 36 mm across"),
        "{odd}"
    );
    // What was joined before is of the clay.
    let bridge = "do = \"union\"\nshape = { box_mm = [80, 4, 4] }\nposition_mm = [50, 0, \
        0]\n[[stroke]]\nat_s = 2\n";
    assert_eq!(
        fitted(&format!(
            "{bridge}do = \"union\"\nshape = {{ box_mm = [2, 2, 2] }}\nposition_mm = [100, 0, 0]"
        )),
        Ok(String::new())
    );
}
