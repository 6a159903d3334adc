//! `bake --picture` and `bake --picture-3d`.

use std::path::Path;
use std::process::{Command, Output};

/// Runs the program in a folder.
fn hapticd(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hapticd"));
    command.current_dir(folder).args(arguments);
    // Never the cache of the user.
    command
        .env("XDG_CACHE_HOME", folder.join("xdg-cache"))
        .env("XDG_STATE_HOME", folder.join("xdg-state"));
    command.output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_picture_is_a_png_with_the_surface_on_it() {
    let folder = tempfile::tempdir().unwrap();
    let peg = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/models/peg.obj");
    let peg = peg.to_str().unwrap();
    let bake = |voxel_size_mm: &str, picture: &str| {
        hapticd(
            folder.path(),
            &[
                "bake",
                peg,
                "--units",
                "mm",
                "--voxel-size-mm",
                voxel_size_mm,
                "--layers",
                "3",
                "--json",
                "--picture",
                picture,
            ],
        )
    };
    for (voxel_size_mm, picture) in [("1", "fine.png"), ("30", "COARSE.PNG")] {
        let ended = bake(voxel_size_mm, picture);
        assert_eq!(ended.status.code(), Some(0), "{}", text(&ended.stderr));
        let pixels = tiny_skia::Pixmap::load_png(folder.path().join(picture)).unwrap();
        assert!(
            (900..=1600).contains(&pixels.width()) && (300..=1300).contains(&pixels.height()),
            "{} x {}",
            pixels.width(),
            pixels.height()
        );
        let share = |is: fn([u8; 3]) -> bool| {
            let n = pixels
                .pixels()
                .iter()
                .filter(|pixel| is([pixel.red(), pixel.green(), pixel.blue()]))
                .count();
            n as f64 / pixels.pixels().len() as f64
        };
        let dark = share(|[red, green, blue]| red < 60 && green < 60 && blue < 60);
        let blue = share(|[red, _, blue]| i16::from(blue) - i16::from(red) > 60);
        let orange = share(|[red, _, blue]| i16::from(red) - i16::from(blue) > 60);
        assert!(dark > 0.01 && blue > 0.02, "{picture}: {dark} dark, {blue} blue");
        // Voxels larger than the peg have no inside, but the legend has one.
        assert!(
            orange > if voxel_size_mm == "1" { 0.05 } else { 0.0005 },
            "{picture}: {orange} orange"
        );
    }
    let same = || bake("1", "again.png");
    same();
    let [first, again] =
        ["fine.png", "again.png"].map(|name| std::fs::read(folder.path().join(name)).unwrap());
    assert!(first == again, "the same bake draws the same bytes");
}

/// Of surface that was left out, of skins, and of the hatching of hollows.
const MARKS: [[u8; 3]; 3] = [[196, 30, 96], [0, 130, 90], [84, 52, 128]];

#[test]
fn a_picture_marks_what_was_left_out_skins_and_hollows_and_nothing_in_a_clean_block() {
    let folder = tempfile::tempdir().unwrap();
    let pieces = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/pictures/solid-pieces.obj");
    let all = std::fs::read_to_string(pieces).unwrap();
    // The block comes first, its eight corners and six faces.
    let block: String = all.split_inclusive('\n').take(1 + 1 + 8 + 6).collect();
    std::fs::write(folder.path().join("pieces.obj"), &all).unwrap();
    std::fs::write(folder.path().join("block.obj"), block).unwrap();
    let n_marked = |mesh: &str, more: &[&str]| {
        let line = ["bake", mesh, "--units", "mm", "--voxel-size-mm", "1", "--picture", "cuts.png"];
        let ended = hapticd(folder.path(), &[&line, more].concat());
        assert_eq!(ended.status.code(), Some(0), "{mesh}: {}", text(&ended.stderr));
        let pixels = tiny_skia::Pixmap::load_png(folder.path().join("cuts.png")).unwrap();
        let is = |color: [u8; 3]| {
            let all = pixels.pixels().iter();
            all.filter(|pixel| [pixel.red(), pixel.green(), pixel.blue()] == color).count()
        };
        MARKS.map(is)
    };
    let [left_out, skin, hollow] = n_marked("pieces.obj", &[]);
    // More than the samples of the legend.
    assert!(left_out > 2000 && skin > 1500 && hollow > 1000, "{left_out} {skin} {hollow}");
    assert_eq!(n_marked("block.obj", &[]), [0; 3]);
    // Triangles as they are: nothing is left out.
    assert_eq!(n_marked("pieces.obj", &["--sides", "flood"]), [0; 3]);
}

#[test]
fn a_picture_that_cannot_be_drawn_is_refused_before_the_work() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(
        folder.path().join("part.obj"),
        "v 0 0 0\nv 9 0 0\nv 0 9 0\nv 0 0 9\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n",
    )
    .unwrap();
    std::fs::create_dir(folder.path().join("folder.png")).unwrap();
    let cases = [
        ("cut.jpg", 2, "a picture is a .png"),
        ("none/cut.png", 4, "the folder must exist"),
        ("folder.png", 4, "give a file name"),
    ];
    for (picture, code, fragment) in cases {
        let ended = hapticd(
            folder.path(),
            &["bake", "part.obj", "--units", "mm", "--voxel-size-mm", "1", "--picture", picture],
        );
        assert_eq!(ended.status.code(), Some(code), "{picture}: {}", text(&ended.stderr));
        assert!(
            text(&ended.stderr).contains(fragment) && ended.stdout.is_empty(),
            "{picture}: {}",
            text(&ended.stderr)
        );
    }
    for flag in ["--picture", "--picture-3d"] {
        let ended = hapticd(folder.path(), &["bake", "scene.toml", flag, "cut.png"]);
        assert_eq!(ended.status.code(), Some(2));
        assert!(
            text(&ended.stderr).contains(&format!("{flag} goes with a mesh")),
            "{}",
            text(&ended.stderr)
        );
    }
}

#[test]
fn a_picture_in_three_dimensions_shows_polygons_voxels_and_points() {
    let folder = tempfile::tempdir().unwrap();
    let peg = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/models/peg.obj");
    let bake = |picture| {
        let arguments = [
            "bake",
            peg.to_str().unwrap(),
            "--units",
            "mm",
            "--voxel-size-mm",
            "2",
            "--json",
            "--picture-3d",
            picture,
        ];
        let ended = hapticd(folder.path(), &arguments);
        assert_eq!(ended.status.code(), Some(0), "{}", text(&ended.stderr));
        std::fs::read(folder.path().join(picture)).unwrap()
    };
    let first = bake("first.png");
    assert!(first == bake("again.png"), "the same bake draws the same bytes");
    let pixels = tiny_skia::Pixmap::decode_png(&first).unwrap();
    let third = pixels.width() / 3;
    // Grey polygons, ochre voxels, blue points.
    let share = |n: u32, is: fn([i16; 3]) -> bool| {
        let columns = n * third..(n + 1) * third;
        let all = (0..pixels.height()).flat_map(|y| columns.clone().map(move |x| (x, y)));
        let n_is = all
            .filter_map(|(x, y)| pixels.pixel(x, y))
            .filter(|pixel| is([pixel.red(), pixel.green(), pixel.blue()].map(i16::from)));
        n_is.count() as f64 / f64::from(third * pixels.height())
    };
    let ochre = |[red, _, blue]: [i16; 3]| red - blue > 40;
    let blue = |[red, _, blue]: [i16; 3]| blue - red > 60;
    let shares = [0, 1, 2].map(|n| [share(n, ochre), share(n, blue)]);
    assert!(
        shares[0] == [0.0; 2] && shares[1][0] > 0.05 && shares[2][0] == 0.0 && shares[2][1] > 0.005,
        "{shares:?}"
    );
}
