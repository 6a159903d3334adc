use super::super::scene_keys::unlike;
use super::super::testing::{SCENE, scene};
use super::*;

#[test]
fn a_mesh_is_read_for_its_companions_only_when_it_was_written_anew() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let at = |name: &str| folder.path().join(name);
    let gltf = |buffer: &str| {
        format!(
            r#"{{ "asset": {{ "version": "2.0" }}, "buffers": [{{ "byteLength": 4, "uri": "{buffer}" }}] }}"#
        )
    };
    let noon = SystemTime::UNIX_EPOCH + Duration::from_secs(1_700_000_000);
    let write = |buffer: &str, time: SystemTime| {
        std::fs::write(at("part.gltf"), gltf(buffer)).expect("written");
        std::fs::File::options()
            .write(true)
            .open(at("part.gltf"))
            .expect("there")
            .set_modified(time)
            .expect("set");
    };
    let mut config = scene(SCENE);
    config.tool.source = MeshSource::File { path: at("part.gltf"), metres_per_unit: 1.0 };
    let mut companions = Companions::default();
    let mut named = |name: &str| companions.meshes(&config).0.contains_key(&at(name));
    write("one.bin", noon);
    assert!(named("one.bin"));
    // The same stamp: what it says now is not looked at.
    write("two.bin", noon);
    assert!(named("one.bin") && !named("two.bin"));
    write("two.bin", noon + Duration::from_secs(1));
    assert!(!named("one.bin") && named("two.bin"));
}

#[test]
fn a_scene_with_another_deadman_or_heartbeat_replaces_none() {
    let rendered = scene(SCENE);
    let held = scene(&format!("{SCENE}[safety]\ndeadman = 2\n"));
    let differences = [
        (unlike(&held, &rendered), Some(("safety.deadman", "2", "\"off\""))),
        (unlike(&rendered, &held), Some(("safety.deadman", "\"off\"", "2"))),
        (unlike(&held, &held), None),
    ];
    for (found, expected) in differences {
        assert_eq!(found.as_ref().map(|(key, its, ours)| (*key, &**its, &**ours)), expected);
    }
    let heard = scene(&format!("{SCENE}[safety]\nheartbeat_ms = 250.0\n"));
    let expected = ("safety.heartbeat_ms", "none".to_owned(), "250".to_owned());
    assert_eq!(unlike(&rendered, &heard), Some(expected));
}

#[test]
fn what_counts_at_the_start_is_named() {
    let rendered = scene(SCENE);
    assert_eq!(fixed(&rendered, &rendered), None);
    for (more, expected) in [
        ("[device.sim]\nhand = \"none\"", ("device.sim.hand", "\"none\"", "present")),
        ("[device.sim]\nfault = \"nan@2s\"", ("device.sim.fault", "\"nan@2s\"", "none")),
        ("[device.sim]\nhand_mass_g = 80.0", ("device.sim.hand_mass_g", "80", "150")),
        ("[realtime]\npriority = 60", ("realtime.priority", "60", "80")),
        (
            "[monitor]\norigins = [\"https://lab.example\"]",
            ("monitor.origins", "[\"https://lab.example\"]", "[]"),
        ),
    ] {
        let (key, its, ours) =
            fixed(&scene(&format!("{SCENE}{more}\n")), &rendered).expect("a difference");
        assert_eq!((key, &*its, &*ours), expected);
    }
}
