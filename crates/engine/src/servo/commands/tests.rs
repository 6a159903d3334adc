#![expect(
    clippy::disallowed_macros,
    clippy::expect_used,
    clippy::indexing_slicing,
    clippy::float_cmp,
    reason = "test code; values that are copied"
)]

use core::cell::Cell;

use glam::{DQuat, DVec3};

use super::*;
use arms::simulated::hand::HandPath;
use haptics::testing::{empty_scene, parameters};

fn objects() -> Objects {
    vec![("floor".to_owned(), false), ("plate".to_owned(), true)]
}

/// Both ends, and a scene that is rendered, of two objects.
fn ends() -> (SceneControls, CommandQueue, Box<LoadedScene>) {
    let (controls, queue) = SceneControls::new(&parameters(), objects());
    (controls, queue, loaded())
}

fn loaded() -> Box<LoadedScene> {
    let mut scene = LoadedScene::new(empty_scene());
    scene.asked_poses = Box::new([None; 2]);
    Box::new(scene)
}

fn at(x_m: f64) -> Pose {
    Pose::from_translation(DVec3::X * x_m)
}

fn setting(controls: &SceneControls, parameter: LiveParameter) -> ParameterSetting {
    *controls.settings().iter().find(|setting| setting.parameter == parameter).expect("a parameter")
}

#[test]
fn a_pose_comes_out_once_and_a_bad_one_never_goes_in() {
    let (mut controls, mut queue, mut scene) = ends();
    let mut next = |queue: &mut CommandQueue| {
        queue.receive(&mut scene, 0);
        queue.next_placement(&mut scene, 0.0)
    };
    assert_eq!(next(&mut queue), None);
    assert_eq!(controls.place("plate", at(1.0)), Ok(()));
    assert_eq!(next(&mut queue), Some(Placement { obstacle_idx: 1, world_from_map: at(1.0) }));
    assert_eq!(next(&mut queue), None);
    assert_eq!(
        controls.place("floor", at(1.0)),
        Err(ControlError::NotMovable { name: "floor".to_owned() })
    );
    let unknown = controls.place("plaet", at(1.0)).expect_err("unknown");
    assert_eq!(unknown.to_string(), "no object is called `plaet`; known here: plate");
    for wrong in [
        Pose::from_translation(DVec3::NAN),
        Pose::from_translation(DVec3::X * 1e9),
        Pose::new(DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), DVec3::ZERO),
        Pose::new(DQuat::from_xyzw(0.0, 0.0, 0.0, 1.1), DVec3::ZERO),
        Pose::new(DQuat::from_xyzw(f64::NAN, 0.0, 0.0, 1.0), DVec3::ZERO),
    ] {
        assert_eq!(
            controls.place("plate", wrong),
            Err(ControlError::Pose { name: "plate".to_owned() })
        );
    }
    assert_eq!(next(&mut queue), None);
    for n in 0..RING_COMMANDS {
        assert_eq!(controls.place("plate", at(n as f64)), Ok(()));
    }
    assert_eq!(controls.place("plate", at(0.0)), Err(ControlError::Full));
    assert_eq!(
        next(&mut queue).map(|placement| placement.world_from_map),
        Some(at((RING_COMMANDS - 1) as f64)),
        "the newest"
    );
    assert_eq!(next(&mut queue), None);
    drop(queue);
    assert_eq!(controls.place("plate", at(0.0)), Err(ControlError::Over));
}

#[test]
fn paths_take_turns_and_a_client_goes_first() {
    let named = vec![("a".to_owned(), true), ("b".to_owned(), true)];
    let (mut controls, queue) = SceneControls::new(&parameters(), named.clone());
    let path = |x_m: f64| HandPath::fixed(at(x_m));
    let paths =
        ObjectPaths::new(&named, [("a".to_owned(), path(1.0)), ("b".to_owned(), path(2.0))])
            .expect("sound");
    let mut queue = queue.with_paths(paths);
    let mut scene = loaded();
    let mut next = |queue: &mut CommandQueue| {
        queue.receive(&mut scene, 0);
        queue
            .next_placement(&mut scene, 0.0)
            .map(|asked| (asked.obstacle_idx, asked.world_from_map.translation.x))
    };
    assert_eq!(
        [(); 3].map(|()| next(&mut queue)),
        [Some((1, 2.0)), Some((0, 1.0)), Some((1, 2.0))]
    );
    controls.place("b", at(3.0)).expect("room");
    assert_eq!([(); 2].map(|()| next(&mut queue)), [Some((1, 3.0)), Some((0, 1.0))]);
    let paths =
        |names: [&str; 2]| ObjectPaths::new(&named, names.map(|name| (name.to_owned(), path(0.0))));
    assert!(matches!(paths(["a", "c"]), Err(ControlError::UnknownObject { .. })));
    assert!(matches!(paths(["a", "a"]), Err(ControlError::Twice { .. })));
}

#[test]
fn a_value_within_its_range_goes_in_and_nothing_else() {
    let (mut controls, mut queue, mut scene) = ends();
    let ParameterSetting { parameter, range, .. } = controls.settings()[0];
    let half = 0.5 * (range.least + range.most);
    assert_eq!(controls.set(parameter.name(), half), Ok(()));
    assert_eq!(queue.next_change(), None, "nothing was received");
    queue.receive(&mut scene, 0);
    assert_eq!(queue.next_change(), Some(ParameterChange { parameter, value: half }));
    assert_eq!(controls.settings()[0], ParameterSetting { parameter, range, value: half });
    for value in [f64::NAN, range.most * 1.001, -1.0, f64::INFINITY] {
        assert!(
            matches!(controls.set(parameter.name(), value), Err(ControlError::Range { .. })),
            "{value}"
        );
    }
    let unknown = controls.set("stiffness", 1.0).expect_err("unknown").to_string();
    assert!(unknown.contains("contact_stiffness_n_per_m"), "{unknown}");
    for _ in 0..RING_COMMANDS {
        assert_eq!(controls.set(parameter.name(), half), Ok(()));
    }
    assert_eq!(controls.set(parameter.name(), half), Err(ControlError::Full));
    drop(queue);
    assert!(controls.is_over());
    assert_eq!(controls.set(parameter.name(), half), Err(ControlError::Over));
}

#[test]
fn several_go_in_together_or_none_does() {
    let (mut controls, mut queue, mut scene) = ends();
    let mut file = parameters();
    file.contact.stiffness_n_per_m *= 0.5;
    file.limits.force_n *= 0.5;
    let changes = controls.file_changes(&file).expect("in range");
    let names: Vec<_> = changes.iter().map(|change| change.name).collect();
    assert_eq!(names, ["contact_stiffness_n_per_m", "limit_force_n"]);
    let first = controls.settings()[0];
    for _ in 1..RING_COMMANDS {
        assert_eq!(controls.set(first.parameter.name(), first.value), Ok(()));
    }
    assert_eq!(controls.follow_file(&file, &changes), Err(ControlError::Full));
    queue.receive(&mut scene, 0);
    assert_eq!(
        (queue.next_change().map(|change| change.value), controls.settings()[0]),
        (Some(first.value), first)
    );
    assert_eq!(controls.follow_file(&file, &changes), Ok(()));
    queue.receive(&mut scene, 0);
    // The limit goes first.
    let next = [(); 3].map(|()| queue.next_change().map(|change| change.parameter));
    assert_eq!(
        next,
        [Some(LiveParameter::ForceLimit), Some(LiveParameter::ContactStiffness), None]
    );
    assert_eq!(controls.file_changes(&file), Some(Vec::new()));
    assert_eq!(setting(&controls, LiveParameter::ForceLimit).range.scene, file.limits.force_n);
    file.contact.stiffness_n_per_m = f64::NAN;
    assert_eq!(controls.file_changes(&file), None);
}

#[test]
fn a_client_asks_for_no_larger_limit_than_the_file_has_now() {
    let (mut controls, mut queue, mut scene) = ends();
    let mut file = parameters();
    let scene_n = file.limits.force_n;
    file.limits.force_n = 0.5 * scene_n;
    let changes = controls.file_changes(&file).expect("in range");
    controls.follow_file(&file, &changes).expect("room");
    let name = LiveParameter::ForceLimit.name();
    assert!(matches!(controls.set(name, 0.6 * scene_n), Err(ControlError::Range { .. })));
    assert_eq!(controls.set(name, 0.4 * scene_n), Ok(()));
    queue.receive(&mut scene, 0);
    assert_eq!(
        queue.next_change(),
        Some(ParameterChange { parameter: LiveParameter::ForceLimit, value: 0.4 * scene_n })
    );
}

#[test]
fn what_a_person_lowered_holds_until_a_person_raises_it() {
    let (mut controls, mut queue, mut scene) = ends();
    let name = LiveParameter::ForceLimit.name();
    let all_n = parameters().limits.force_n;
    let mut rendered_idx = 0;
    // Another scene takes over; what its first tick gets of the limit, and what is shown of it.
    let mut exchange = |controls: &mut SceneControls, queue: &mut CommandQueue| {
        controls.offer(loaded(), objects()).map_err(|(error, _)| error).expect("room");
        assert!(matches!(controls.offer(loaded(), objects()), Err((SwapError::Waiting, _))));
        queue.receive(&mut scene, rendered_idx);
        assert!(controls.take_replaced().is_none(), "not yet");
        assert!(
            queue.is_scene_due(&mut scene, (0, rendered_idx), ClockKind::Real, || false)
                && queue.exchange(&mut scene)
        );
        rendered_idx += 1;
        // What comes for the scene before is dropped, but for a limit.
        controls
            .set("contact_stiffness_n_per_m", 0.5 * parameters().contact.stiffness_n_per_m)
            .expect("room");
        queue.receive(&mut scene, rendered_idx);
        let reported = [queue.next_change(), queue.next_change()];
        assert!(controls.take_replaced().is_some() && controls.scene_idx() == rendered_idx);
        (reported, setting(controls, LiveParameter::ForceLimit).value)
    };
    // The value of the scene is not lowered.
    controls.set(name, all_n).expect("room");
    assert_eq!(exchange(&mut controls, &mut queue), ([None, None], all_n));
    let limit =
        |value: f64| [Some(ParameterChange { parameter: LiveParameter::ForceLimit, value }), None];
    controls.set(name, 0.5 * all_n).expect("room");
    assert_eq!(exchange(&mut controls, &mut queue), (limit(0.5 * all_n), 0.5 * all_n));
    assert_eq!(controls.file_changes(&parameters()), Some(Vec::new()), "no file raises it");
    assert!(matches!(controls.set(name, f64::NAN), Err(ControlError::Range { .. })));
    // Raised to all that this scene has: no more than that in the next one.
    controls.set(name, all_n).expect("room");
    assert_eq!(exchange(&mut controls, &mut queue), (limit(all_n), all_n));
}

#[test]
fn simulated_time_waits_for_a_promised_scene_and_not_for_one_that_will_not_come() {
    let (mut controls, queue, mut scene) = ends();
    let mut queue = queue.with_promised(Box::new([10, 20]));
    let mut is_due = |queue: &mut CommandQueue, tick: u64, clock| {
        queue.is_scene_due(&mut scene, (tick, 0), clock, || false)
    };
    assert!(!is_due(&mut queue, 9, ClockKind::Virtual) && !is_due(&mut queue, 10, ClockKind::Real));
    controls.skip().expect("room");
    assert!(!is_due(&mut queue, 10, ClockKind::Virtual));
    let offered = Box::new(LoadedScene::new(empty_scene()).at_tick(20));
    let sender = std::thread::spawn(move || {
        controls.offer(offered, objects()).map_err(|(error, _)| error).expect("room");
        controls
    });
    assert!(is_due(&mut queue, 20, ClockKind::Virtual));
    drop(sender.join().expect("no panic"));
    let (_, queue, mut scene) = ends();
    let mut queue = queue.with_promised(Box::new([0]));
    assert!(
        !queue.is_scene_due(&mut scene, (0, 0), ClockKind::Virtual, || false),
        "the sender has gone"
    );
}

#[test]
fn the_newest_order_for_the_hand_counts_from_the_read_after_it() {
    let (mut controls, mut queue, mut scene) = ends();
    let mut hand = HandControl::new(None);
    assert_eq!((controls.hand(HandOrder::Restart), controls.hand_use()), (Ok(1), None));
    assert_eq!(controls.hand(HandOrder::MoveTo(at(0.1))), Ok(2));
    assert!(controls.hand(HandOrder::MoveTo(at(f64::NAN))).is_err());
    // Nothing has been reported yet when the arm is read in the tick that takes them.
    queue.receive(&mut scene, 0);
    queue.note_read(monotonic_ns());
    assert_eq!(controls.hand_use(), None);
    queue.guide_hand(Some(&mut hand), Pose::IDENTITY);
    assert_eq!(controls.hand_use(), None);
    queue.note_read(monotonic_ns() + 3_000_000);
    let HandUse { number, waited_us } = controls.hand_use().expect("used");
    assert_eq!(number, 2, "of two before a tick the newer one");
    assert!((3000..60_000_000).contains(&waited_us), "{waited_us}");
    // Once only.
    queue.note_read(monotonic_ns() + 1_000_000_000);
    assert_eq!(controls.hand_use(), Some(HandUse { number, waited_us }));
    // Of a scene that is not rendered it is dropped, and without a hand nothing is used.
    assert_eq!(controls.hand(HandOrder::Restart), Ok(3));
    queue.receive(&mut scene, 1);
    queue.guide_hand(Some(&mut hand), Pose::IDENTITY);
    assert_eq!(controls.hand(HandOrder::Restart), Ok(4));
    queue.receive(&mut scene, 0);
    queue.guide_hand(None, Pose::IDENTITY);
    queue.note_read(monotonic_ns());
    assert_eq!(controls.hand_use().map(|used| used.number), Some(2));
}

#[test]
fn only_objects_that_may_move_are_named_as_movable() {
    let (controls, _queue, _scene) = ends();
    assert_eq!(controls.movable().collect::<Vec<_>>(), ["plate"]);
}

#[test]
fn a_file_with_one_value_out_of_its_range_is_not_followed() {
    let (controls, _queue, _scene) = ends();
    let ParameterSetting { range, .. } = setting(&controls, LiveParameter::ContactStiffness);
    let is_followed = |value: f64| {
        let mut file = parameters();
        file.contact.stiffness_n_per_m = value;
        controls.file_changes(&file).is_some()
    };
    assert!(is_followed(range.least) && is_followed(range.most));
    assert!(!is_followed(0.999 * range.least) && !is_followed(1.001 * range.most));
}

#[test]
fn a_file_needs_a_place_for_each_change_and_no_more() {
    let (mut controls, _queue, _scene) = ends();
    let mut file = parameters();
    file.contact.stiffness_n_per_m *= 0.5;
    file.limits.force_n *= 0.5;
    let changes = controls.file_changes(&file).expect("in range");
    let ParameterSetting { parameter, value, .. } = controls.settings()[0];
    for _ in changes.len()..RING_COMMANDS {
        assert_eq!(controls.set(parameter.name(), value), Ok(()));
    }
    assert_eq!(controls.follow_file(&file, &changes), Ok(()));
    assert_eq!(controls.set(parameter.name(), value), Err(ControlError::Full));
    assert_eq!(controls.follow_file(&file, &[]), Ok(()), "nothing is sent");
}

/// True when simulated time would wait for a scene: whether it is hurried is what it asks last.
fn waits(queue: &mut CommandQueue, scene: &mut LoadedScene, tick: u64) -> bool {
    let has_asked = Cell::new(false);
    let is_hurried = || {
        has_asked.set(true);
        true
    };
    assert!(!queue.is_scene_due(scene, (tick, 0), ClockKind::Virtual, is_hurried));
    has_asked.get()
}

#[test]
fn a_scene_that_has_come_and_one_that_will_not_take_the_place_of_one_promise_each() {
    let (mut controls, queue, mut scene) = ends();
    let mut queue = queue.with_promised(Box::new([10, 20, 30]));
    assert!(!waits(&mut queue, &mut scene, 9) && waits(&mut queue, &mut scene, 10));
    controls.skip().expect("room");
    queue.receive(&mut scene, 0);
    assert!(!waits(&mut queue, &mut scene, 19) && waits(&mut queue, &mut scene, 20));
    controls.offer(loaded(), objects()).map_err(|(error, _)| error).expect("room");
    queue.receive(&mut scene, 0);
    assert!(queue.exchange(&mut scene));
    assert!(!waits(&mut queue, &mut scene, 29) && waits(&mut queue, &mut scene, 30));
}

#[test]
fn a_scene_that_was_sent_before_its_sender_went_is_taken() {
    let (mut controls, queue, mut scene) = ends();
    let mut queue = queue.with_promised(Box::new([0]));
    controls.offer(loaded(), objects()).map_err(|(error, _)| error).expect("room");
    drop(controls);
    assert!(queue.is_scene_due(&mut scene, (0, 0), ClockKind::Virtual, || false));
}

#[test]
fn a_scene_waits_until_there_is_a_place_for_the_one_before() {
    let (mut controls, mut queue, mut scene) = ends();
    queue.replaced.push(loaded()).expect("room");
    controls.offer(loaded(), objects()).map_err(|(error, _)| error).expect("room");
    queue.receive(&mut scene, 0);
    assert!(!queue.is_scene_due(&mut scene, (0, 0), ClockKind::Real, || false));
    assert!(controls.replaced.pop().is_ok());
    assert!(queue.is_scene_due(&mut scene, (0, 0), ClockKind::Real, || false));
}

#[test]
fn how_long_an_order_has_waited_is_kept_within_what_is_reported_of_it() {
    let used = |at_ns: i64, now_ns: i64| {
        let newest = NewestUse::default();
        newest.set(Sent { number: 7, at_ns }, now_ns);
        newest.get()
    };
    let waited = |waited_us: u32| Some(HandUse { number: 7, waited_us });
    assert_eq!(used(1_000_000, 4_000_999), waited(3000));
    assert_eq!(used(1_000_000, 0), waited(0), "read before it came");
    assert_eq!(used(0, i64::MAX), waited(u32::MAX));
}
