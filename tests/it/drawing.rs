//! `run --pictures` and `--video`: pictures and films of a run, drawn without a display.

use std::fs;
use std::path::Path;

use super::program::hapticd;

/// A ball that goes down onto a plate and up again within a fifth of a second.
const SCENE: &str = r#"version = 1
[[static]]
name = "plate"
shape = { box_mm = [60.0, 60.0, 6.0] }
voxel_size_mm = 1.0
[tool]
shape = { sphere_mm = 10.0 }
voxel_size_mm = 1.0
start_position_mm = [0.0, 0.0, 20.0]
[device]
hand = "hand.csv"
"#;
const HAND: &str = "t_s,x_m,y_m,z_m,qx,qy,qz,qw\n0,0,0,0.02,0,0,0,1\n0.1,0.01,0,0.012,0,0,0,1\n0.2,0.02,0,0.02,0,0,0,1\n";

fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().expect("a folder");
    fs::write(dir.path().join("ball.toml"), SCENE).expect("written");
    fs::write(dir.path().join("hand.csv"), HAND).expect("written");
    dir
}

/// Frames that an animated PNG announces, and those that are in it.
fn frames(film: &Path) -> (u32, usize) {
    let bytes = fs::read(film).expect("a film");
    let at = bytes.windows(4).position(|kind| kind == b"acTL").expect("an animated PNG");
    let announced = u32::from_be_bytes(bytes[at + 4..at + 8].try_into().expect("four"));
    (announced, bytes.windows(4).filter(|kind| kind == b"fcTL").count())
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_run_under_the_virtual_clock_leaves_every_picture_and_every_frame() {
    let dir = folder();
    let line = "run ball.toml --clock virtual --duration 200ms --pictures drawn --picture-every \
        100ms --video ball.apng --cache off --json";
    let ended = hapticd(dir.path(), line);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    assert!(ended.stderr.contains("made the folder drawn for pictures"), "{}", ended.stderr);
    let json = ended.json();
    let n_ticks = json["ticks"].as_u64().expect("a number");
    // The first tick, at 1 ms, each multiple, and the last tick where it is none of them.
    let due = |every_ms: u64| n_ticks / every_ms + 1 + u64::from(!n_ticks.is_multiple_of(every_ms));
    assert_eq!(json["drawn"]["frames"], due(40), "{json}");
    assert_eq!(json["drawn"]["pictures"], due(100), "{json}");
    assert!(
        json["drawn"]["left_out"] == 0
            && json["drawn"]["video"] == "ball.apng"
            && json["drawn"]["error"].is_null(),
        "{json}"
    );
    let film = dir.path().join("ball.apng");
    assert_eq!(frames(&film), (due(40) as u32, due(40) as usize));
    let names: Vec<String> = fs::read_dir(dir.path().join("drawn"))
        .expect("a folder")
        .map(|entry| entry.expect("a file").file_name().into_string().expect("a name"))
        .collect();
    assert_eq!(names.len() as u64, due(100), "{names:?}");
    let load = |name: &str| {
        tiny_skia::Pixmap::load_png(dir.path().join("drawn").join(name))
            .unwrap_or_else(|error| panic!("{name}: {error}"))
    };
    let [first, second] = ["ball-00000.001s.png", "ball-00000.100s.png"].map(load);
    assert_eq!([first.width(), first.height()], [720, 540]);
    assert!(first.data() != second.data(), "the ball has moved");
    // Nothing but the film is left in the folder of the film: it was made beside its name.
    let left: Vec<_> = fs::read_dir(dir.path())
        .expect("a folder")
        .flatten()
        .map(|entry| entry.file_name())
        .collect();
    assert!(left.iter().all(|name| !name.to_string_lossy().starts_with(".tmp")), "{left:?}");
    let before = fs::read(&film).expect("a film");
    let refused = hapticd(dir.path(), line);
    assert_eq!(refused.code, Some(2), "{}", refused.stderr);
    let again = hapticd(dir.path(), &format!("{line} --overwrite"));
    assert_eq!(again.code, Some(0), "{}", again.stderr);
    assert!(fs::read(&film).expect("a film") == before, "the same run draws the same bytes");
}

#[test]
fn under_the_real_clock_every_frame_is_drawn_or_counted() {
    let dir = folder();
    let line = "run ball.toml --realtime best-effort --duration 300ms --video ball.png --cache off \
        --json --flight off --monitor off";
    let ended = hapticd(dir.path(), line);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let json = ended.json();
    let [n_frames, left_out] =
        ["frames", "left_out"].map(|key| json["drawn"][key].as_u64().expect("a number"));
    assert!(n_frames >= 1 && n_frames + left_out >= 6, "{json}");
    assert_eq!(frames(&dir.path().join("ball.png")), (n_frames as u32, n_frames as usize));
}

#[test]
fn what_cannot_be_drawn_is_refused_before_anything_is_baked() {
    let dir = folder();
    fs::write(dir.path().join("there.apng"), "").expect("written");
    fs::create_dir(dir.path().join("earlier")).expect("made");
    fs::write(dir.path().join("earlier/ball-00012.000s.png"), "").expect("written");
    for (flags, code, fragments) in [
        ("--video film.mp4", 2, &["a film is an animated PNG", ".apng"][..]),
        ("--video there.apng", 2, &["there.apng is there already", "--overwrite"]),
        ("--video none/film.apng", 4, &["cannot write none/film.apng", "the folder must exist"]),
        ("--video /dev/null.png/x.apng", 4, &["cannot write"]),
        ("--pictures earlier", 2, &["earlier/ball-00012.000s.png is there already", "--overwrite"]),
        ("--pictures ball.toml", 4, &["cannot make the folder ball.toml"]),
        ("--pictures p --picture-every 0s", 2, &["at least 1ms"]),
    ] {
        let ended =
            hapticd(dir.path(), &format!("run ball.toml --clock virtual --duration 1s {flags}"));
        assert_eq!(ended.code, Some(code), "{flags}: {}", ended.stderr);
        assert!(
            fragments.iter().all(|fragment| ended.stderr.contains(fragment)),
            "{flags}: {}",
            ended.stderr
        );
        assert!(!ended.stderr.contains("state: baking"), "{flags}: {}", ended.stderr);
    }
    fs::write(dir.path().join("clay.toml"), "version = 1\n").expect("written");
    let ended = hapticd(dir.path(), "sculpt clay.toml --video clay.apng");
    assert_eq!(ended.code, Some(2), "{}", ended.stderr);
    assert!(ended.stderr.contains("--video is for rigid scenes"), "{}", ended.stderr);
}
