//! The loop neither allocates nor frees: counted over 10⁵ steps of every shipped scene, and over
//! 10⁴ of every coupling, field and injectable fault on the smallest one.
#![expect(unsafe_code, reason = "the trait of a global allocator is unsafe")]
#![expect(clippy::print_stderr, reason = "the long runs say how far they are")]

mod arms;
#[path = "../hil/maker.rs"]
#[expect(dead_code, reason = "what the tests of faults call is not called here")]
mod maker;
#[path = "../it/meddled.rs"]
mod meddled;
mod remote;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use engine::servo::{
    Control, DensityFeed, DensitySlot, LoadedScene, RunPlan, SceneControls, ServoLoop, Step,
};
use glam::{DQuat, DVec3};
use hapticd::config::{self, SceneConfig};
use hapticd::daemon::prepare_with;
use hapticd::scene::BakeOptions;
use hapticd::scene::cache::{Cache, CachePolicy};
use haptics::clay::{Clay, Rope};
use haptics::{Faults, RenderScene};
use rt::clock::VirtualClock;
use vps::contact::{Budget, ContactSum, SimdLevel, Traversal, TraversalMode};
use vps::density::{DensityFrame, Lattice, Raster};
use vps::spatial::Pose;

/// Counts what the thread under test does; other threads (and the harness) allocate as they like.
struct CountingAllocator;

thread_local! {
    // Constant and without a destructor: reading them allocates nothing.
    static COUNTING: Cell<bool> = const { Cell::new(false) };
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
    static FREES: Cell<u64> = const { Cell::new(0) };
}

fn count(calls: &'static std::thread::LocalKey<Cell<u64>>) {
    // A thread that is going away is not the one under test.
    if COUNTING.try_with(Cell::get).unwrap_or(false) {
        let _ = calls.try_with(|calls| calls.set(calls.get() + 1));
    }
}

// SAFETY: every call is passed on to the system's allocator unchanged.
unsafe impl GlobalAlloc for CountingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(&ALLOCATIONS);
        // SAFETY: the caller's promise, passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count(&FREES);
        // SAFETY: the caller's promise, passed on.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(&ALLOCATIONS);
        // SAFETY: the caller's promise, passed on.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        count(&ALLOCATIONS);
        // SAFETY: the caller's promise, passed on.
        unsafe { System.realloc(pointer, layout, new_size) }
    }
}

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

/// Allocations and frees of this thread during `work`.
fn counted<T>(work: impl FnOnce() -> T) -> (T, u64, u64) {
    ALLOCATIONS.set(0);
    FREES.set(0);
    COUNTING.set(true);
    let result = work();
    COUNTING.set(false);
    (result, ALLOCATIONS.get(), FREES.get())
}

const TICKS: u64 = 100_000;
/// Steps between two looks at the ring; it holds as many records.
const STRIDE: usize = 1000;

fn scenes() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("config/scenes")
}

/// A shipped scene, with more text before its `[device]` table and other words for some of its own.
fn scene(name: &str, replacements: &[(&str, &str)]) -> SceneConfig {
    let mut text = std::fs::read_to_string(scenes().join(name).with_extension("toml"))
        .expect("a shipped scene");
    for (from, to) in replacements {
        assert!(text.contains(from), "{name} has no `{from}`");
        text = text.replace(from, to);
    }
    text = text.replace("\"../models/", &format!("\"{}/", scenes().join("../models").display()));
    text = text.replace("\"hands/", &format!("\"{}/", scenes().join("hands").display()));
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, text).expect("written");
    config::load(&path).unwrap_or_else(|errors| panic!("{errors}"))
}

/// There and back again until the end of the run, so that contact comes and goes all the time.
fn hand_there_and_back(hand: &Path, folder: &Path) -> PathBuf {
    let text = std::fs::read_to_string(hand).expect("a hand file");
    let rows: Vec<(f64, &str)> = text
        .lines()
        .skip(1)
        .filter_map(|line| line.split_once(','))
        .map(|(time, pose)| (time.parse().expect("a time"), pose))
        .collect();
    let end_s = rows.last().expect("rows").0;
    let mut looped = format!("{}\n", text.lines().next().expect("a header"));
    let mut start_s = 0.0;
    while start_s < TICKS as f64 * 1e-3 {
        for (time_s, pose) in &rows {
            let _ = writeln!(looped, "{:.3},{pose}", start_s + time_s);
        }
        for (time_s, pose) in rows.iter().rev() {
            let _ = writeln!(looped, "{:.3},{pose}", start_s + 0.005 + 2.0 * end_s - time_s);
        }
        start_s += 2.0 * end_s + 0.01;
    }
    let path = folder.join("hand.csv");
    std::fs::write(&path, looped).expect("written");
    path
}

/// Steps through a run, counting; returns its faults and how many ticks it had, and how many of
/// them in contact.
fn step_through(what: &str, config: SceneConfig, n_ticks: u64) -> (Faults, u64, u64) {
    step_through_with(what, config, &mut Cache::off(), n_ticks)
}

/// The same, with a bake cache.
fn step_through_with(
    what: &str,
    mut config: SceneConfig,
    cache: &mut Cache,
    n_ticks: u64,
) -> (Faults, u64, u64) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    config.device.hand = config.device.hand.map(|hand| hand_there_and_back(&hand, folder.path()));
    let (prepared, _) = prepare_with(&config, &mut BakeOptions::from(cache), |_| ())
        .unwrap_or_else(|error| panic!("{what}: {error}"));
    let (producer, mut consumer) = rtrb::RingBuffer::new(STRIDE);
    let control = Arc::new(Control::enabled());
    let plan = RunPlan { stop_at_tick: Some(n_ticks), ..RunPlan::default() };
    let mut servo = ServoLoop::new(
        Arc::new(prepared.scene),
        prepared.device,
        VirtualClock::default(),
        control,
        plan,
        producer,
    );
    servo.warm_up();
    let mut ticks = 0;
    let mut touching = 0;
    let mut faults = Faults::NONE;
    loop {
        let (last, allocations, frees) = counted(|| {
            let mut last = Step::Continue;
            for _ in 0..STRIDE {
                last = servo.step();
                if last == Step::End {
                    break;
                }
            }
            last
        });
        assert_eq!(
            (allocations, frees),
            (0, 0),
            "{what}: allocations and frees within {STRIDE} ticks from tick {ticks} on"
        );
        while let Ok(record) = consumer.pop() {
            ticks += 1;
            touching += u64::from(record.output.contacts > 0);
            faults |= record.output.faults;
        }
        if ticks % 20_000 == 0 {
            eprintln!("{what}: {ticks} of {n_ticks} ticks");
        }
        if last == Step::End {
            eprintln!(
                "{what}: {ticks} ticks, {touching} in contact, faults {:?}",
                faults.names().collect::<Vec<_>>()
            );
            return (faults, ticks, touching);
        }
    }
}

fn whole_scene(name: &str) {
    let (faults, ticks, touching) = step_through(name, scene(name, &[]), TICKS);
    assert!(faults.is_empty(), "{name}: {:?}", faults.names().collect::<Vec<_>>());
    assert!(
        ticks >= TICKS && touching > TICKS / 10,
        "{name}: {ticks} ticks, {touching} in contact"
    );
}

#[test]
fn the_counter_counts() {
    let ((), allocations, frees) = counted(|| drop(std::hint::black_box(Box::new(1))));
    assert_eq!((allocations, frees), (1, 1));
    let (_, allocations, _) = counted(|| {
        let mut numbers = Vec::with_capacity(1);
        numbers.extend(std::hint::black_box([1, 2, 3]));
        numbers
    });
    assert_eq!(allocations, 2, "growing counts");
}

// The three large scenes are tests of their own, so that the harness runs them side by side.

#[test]
fn peg_in_hole_allocates_nothing() {
    whole_scene("peg-in-hole");
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn gear_on_shaft_allocates_nothing() {
    whole_scene("gear-on-shaft");
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn nut_on_bolt_allocates_nothing() {
    whole_scene("nut-on-bolt");
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn block_on_plane_allocates_nothing_in_any_coupling_and_field() {
    for coupling in ["implicit", "constraint", "direct"] {
        for field in ["layers", "surface-point", "octant", "trilinear"] {
            // The whole length for the scene as it is shipped.
            let n_ticks =
                if coupling == "implicit" && field == "trilinear" { TICKS } else { TICKS / 10 };
            let what = format!("block-on-plane, {coupling}, {field}");
            let config = scene(
                "block-on-plane",
                &[
                    ("coupling = \"implicit\"", &format!("coupling = \"{coupling}\"")),
                    (
                        "field = \"trilinear\"",
                        &format!("field = \"{field}\"\nallow_unstable = true"),
                    ),
                ],
            );
            let (faults, ticks, touching) = step_through(&what, config, n_ticks);
            assert!(faults.is_empty() && ticks >= n_ticks && touching > 0, "{what}");
        }
    }
}

#[test]
fn brakes_and_dampers_allocate_nothing() {
    let coupling = "implicit";
    let what = format!("block-on-plane, {coupling}, with brakes and dampers");
    let keys = "[contact]\nbraking = true\ndamping_n_s_per_m = 20";
    let config = scene(
        "block-on-plane",
        &[("coupling = \"implicit\"", &format!("coupling = \"{coupling}\"")), ("[contact]", keys)],
    );
    let (faults, ticks, touching) = step_through(&what, config, TICKS / 10);
    assert!(faults.is_empty() && ticks >= TICKS / 10 && touching > 0, "{what}");
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_scene_from_the_cache_allocates_nothing() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (what, residence) in
        [("baked", CachePolicy::Copy), ("read", CachePolicy::Copy), ("mapped", CachePolicy::Mapped)]
    {
        let mut cache = Cache::at(folder.path().to_owned(), residence);
        let (faults, ticks, touching) =
            step_through_with(what, scene("block-on-plane", &[]), &mut cache, TICKS / 10);
        assert!(faults.is_empty() && ticks >= TICKS / 10 && touching > 0, "{what}");
        assert_eq!(cache.take_notes(), [""; 0]);
    }
}

/// Objects that move, parameters that change, and scenes that take each other's place: what is made
/// for that is made and freed by another thread.
#[test]
fn moving_objects_turning_knobs_and_swapping_scenes_allocate_nothing() {
    let movable = [("layers = 8", "layers = 8\nmovable = true")];
    let config = scene("block-on-plane", &movable);
    let bake = || {
        prepare_with(&config, &mut BakeOptions::from(&mut Cache::off()), |_| ()).expect("a scene").0
    };
    let prepared = bake();
    let objects = vec![(config.statics[0].name.clone(), true)];
    let (mut controls, commands) = SceneControls::new(&config.parameters, objects.clone());
    let (producer, mut consumer) = rtrb::RingBuffer::new(STRIDE);
    let control = Arc::new(Control::enabled());
    let plan = RunPlan { stop_at_tick: Some(20_000), ..RunPlan::default() };
    let mut servo = ServoLoop::new(
        Arc::new(prepared.scene),
        prepared.device,
        VirtualClock::default(),
        control,
        plan,
        producer,
    )
    .with_commands(commands);
    servo.warm_up();
    let mut n_swaps = 0;
    let mut n_changes = 0;
    let mut moving = 0;
    let mut touching = 0;
    let mut round = 0_u32;
    loop {
        // Up under the block and down again, round by round; another scene every fourth.
        for n in 0..10 {
            let turn = DQuat::from_rotation_x(0.05 * f64::from(round % 3));
            controls
                .place(
                    &objects[0].0,
                    Pose::new(turn, DVec3::Z * (1e-3 * f64::from((3 * round + n) % 12))),
                )
                .expect("room");
        }
        let setting = controls.settings()[round as usize % controls.settings().len()];
        let value = if round.is_multiple_of(2) { setting.range.least } else { setting.range.most };
        controls.set(setting.parameter.name(), value).expect("room");
        if round % 4 == 1 {
            // Refused while the one before waits.
            let _ =
                controls.offer(Box::new(LoadedScene::new(Arc::new(bake().scene))), objects.clone());
        }
        let (last, allocations, frees) = counted(|| {
            (0..STRIDE).map(|_| servo.step()).take_while(|step| *step == Step::Continue).count()
        });
        assert_eq!((allocations, frees), (0, 0), "round {round}");
        n_swaps += u32::from(controls.take_replaced().is_some());
        while let Ok(record) = consumer.pop() {
            assert_eq!(record.output.faults, Faults::NONE);
            n_changes += u32::from(record.input.parameter_change.is_some());
            moving += u32::from(record.output.objects_moving > 0);
            touching += u32::from(record.output.contacts > 0);
        }
        round += 1;
        if last < STRIDE {
            break;
        }
    }
    assert!(n_changes > 10);
    assert!(
        n_swaps >= 3 && moving > 1000 && touching > 1000,
        "{n_swaps} swaps, {moving} ticks moving, {touching} in contact"
    );
}

/// A slab of clay whose top is at a height, with a rope in it every other time.
fn slab_of_clay(sequence: u64, top_m: f64) -> DensityFrame {
    let base = Lattice { origin_map: DVec3::splat(-0.05), spacing_m: 2e-3, dims: [51, 51, 41] };
    let region = Lattice { origin_map: base.position([5, 5, 15]), dims: [41, 41, 20], ..base };
    let raster = |lattice: Lattice| {
        let mut raster = Raster::uniform(lattice, 0.0);
        for (n, value_m) in raster.values_m_mut().iter_mut().enumerate() {
            *value_m = (top_m - lattice.position([0, 0, n % lattice.dims[2]]).z) as f32;
        }
        raster.measure();
        raster
    };
    let rope_map = (sequence % 2 == 1).then_some(DVec3::new(0.01, 0.0, -0.01));
    let mut frame = DensityFrame {
        sequence,
        base: Arc::new(raster(base)),
        region: raster(region),
        rope_map,
        is_leap: sequence.is_multiple_of(7),
    };
    frame.make_ready(None).expect("a sound frame");
    frame
}

/// One frame for every four ticks, up and down.
fn knead(mut feed: DensityFeed) -> u64 {
    let mut n_states = 0_u64;
    let mut n_frames = 0_u64;
    while !feed.is_over() {
        let Some(_) = feed.next_state() else {
            std::thread::yield_now();
            continue;
        };
        n_states += 1;
        if !n_states.is_multiple_of(4) {
            continue;
        }
        let mut next = loop {
            match feed.spare() {
                Some(next) => break next,
                None if feed.is_over() => return n_frames,
                None => std::thread::yield_now(),
            }
        };
        n_frames += 1;
        let top_m = 1e-3 * (n_frames as f64 * 0.05).sin();
        let lattice = *next.region.lattice();
        for (n, value_m) in next.region.values_m_mut().iter_mut().enumerate() {
            *value_m = (top_m - lattice.position([0, 0, n % lattice.dims[2]]).z) as f32;
        }
        (next.sequence, next.rope_map) =
            (n_frames, (n_frames % 40 < 20).then_some(DVec3::Z * 0.01));
        if feed.publish(next).is_err() {
            break;
        }
    }
    n_frames
}

/// Clay that another thread kneads, on and beside a rigid plane: frames go round as pointers.
#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn frames_of_clay_that_come_and_go_allocate_nothing() {
    for coupling in ["implicit", "direct"] {
        let n_ticks = TICKS / 10;
        let mut config = scene(
            "block-on-plane",
            &[
                ("coupling = \"implicit\"", &format!("coupling = \"{coupling}\"")),
                ("field = \"trilinear\"", "field = \"trilinear\"\nallow_unstable = true"),
            ],
        );
        let folder = tempfile::tempdir().expect("a temporary folder");
        config.device.hand =
            config.device.hand.map(|hand| hand_there_and_back(&hand, folder.path()));
        let (prepared, _) =
            prepare_with(&config, &mut BakeOptions::from(&mut Cache::off()), |_| ())
                .expect("a scene");
        let mut scene = prepared.scene;
        let smoothing = Clay::smoothing_between(4e-3, 1e-3);
        let rope = Rope { stiffness_n_per_m: 100.0, force_n: 1.0 };
        let clay =
            Clay { world_from_map: Pose::IDENTITY, frame: slab_of_clay(0, 0.0), smoothing, rope };
        let (feed, slot) = DensitySlot::new(&clay.frame, &clay.world_from_map, 4);
        scene.clay = Some(clay);
        let (producer, mut consumer) = rtrb::RingBuffer::new(STRIDE);
        let control = Arc::new(Control::enabled());
        let plan = RunPlan { stop_at_tick: Some(n_ticks), ..RunPlan::default() };
        let mut servo = ServoLoop::new(
            Arc::new(scene),
            prepared.device,
            VirtualClock::default(),
            control,
            plan,
            producer,
        )
        .with_density(slot);
        servo.warm_up();
        let simulation = std::thread::spawn(|| knead(feed));
        let mut ticks = 0;
        let mut touching = 0;
        let mut last_frame = 0;
        loop {
            let (n_steps, allocations, frees) = counted(|| {
                (0..STRIDE).map(|_| servo.step()).take_while(|step| *step == Step::Continue).count()
            });
            assert_eq!(
                (allocations, frees),
                (0, 0),
                "{coupling}: within {STRIDE} ticks from tick {ticks} on"
            );
            while let Ok(record) = consumer.pop() {
                assert_eq!(record.output.faults, Faults::NONE, "{coupling}, tick {ticks}");
                ticks += 1;
                touching += u64::from(record.output.contacts > 0);
                last_frame = record.input.clay.expect("clay").sequence;
            }
            if n_steps < STRIDE {
                break;
            }
        }
        drop(servo);
        let n_frames = simulation.join().expect("no panic");
        assert!(
            ticks >= n_ticks && touching > n_ticks / 20,
            "{coupling}: {touching} of {ticks} ticks in contact"
        );
        assert!(
            last_frame >= n_ticks / 4 && n_frames >= last_frame,
            "{coupling}: frame {last_frame} of {n_frames}"
        );
    }
}

/// The contact query alone, as no scene can drive it: leaping from pose to pose, deep inside, far
/// off, with budgets of all sizes.
#[test]
fn no_walk_allocates_whatever_its_pose_and_budget() {
    let config = scene("block-on-plane", &[]);
    let (prepared, _) =
        prepare_with(&config, &mut BakeOptions::from(&mut Cache::off()), |_| ()).expect("a scene");
    let RenderScene { parameters, obstacles, tool, .. } = &prepared.scene;
    for (level, mode) in [
        (SimdLevel::Portable, TraversalMode::Tree),
        (SimdLevel::best(), TraversalMode::Tree),
        (SimdLevel::best(), TraversalMode::Flat),
    ] {
        for budget in
            [Budget::Unlimited, Budget::Points(0), Budget::Points(100), Budget::Points(1000)]
        {
            let mut traversal = Traversal::new(level, mode, obstacles, &tool.shell);
            traversal.set_budget(budget);
            let mut touching = 0;
            let mut left_out = 0;
            for turn in 0..500_u32 {
                let angle = f64::from(turn);
                let reach_m = if turn % 50 == 49 { 1e9 } else { 0.05 };
                let place_m =
                    DVec3::new((1.3 * angle).sin(), (2.1 * angle).sin(), (0.7 * angle).sin())
                        * reach_m;
                let pose =
                    Pose::new(DQuat::from_scaled_axis(DVec3::new(0.9, 1.7, 0.4) * angle), place_m);
                let (sum, allocations, frees) = counted(|| {
                    ContactSum::of(
                        &mut traversal,
                        obstacles,
                        &tool.shell,
                        pose,
                        parameters.force_law(),
                        None,
                    )
                });
                assert_eq!(
                    (allocations, frees),
                    (0, 0),
                    "{level:?}, {mode:?}, {budget:?}, {pose:?}"
                );
                touching += sum.contacts;
                left_out += sum.left_out;
            }
            assert!(touching > 0 || budget == Budget::Points(0), "{level:?}, {mode:?}, {budget:?}");
            assert_eq!(
                left_out > 0,
                mode == TraversalMode::Tree && budget != Budget::Unlimited,
                "{level:?}, {mode:?}, {budget:?}"
            );
        }
    }
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn no_fault_allocates_on_its_way_in() {
    for (fault, expected) in [
        ("nan@1200ms", Some(Faults::NON_FINITE)),
        ("jump@1200ms", Some(Faults::POSITION_JUMP)),
        ("unplug@1200ms", Some(Faults::DEVICE_LOST)),
        ("stall@1200ms", Some(Faults::STALE)),
        ("stuck@1200ms", None),
        ("drop=5%", None),
        ("sign-flip@1200ms", None),
    ] {
        let with_fault = format!("[device.sim]\nfault = \"{fault}\"\n\n[realtime]");
        let config = scene("block-on-plane", &[("[realtime]", &with_fault)]);
        let n_ticks = if expected.is_some() { 5000 } else { TICKS };
        let (faults, ticks, touching) = step_through(fault, config, n_ticks);
        assert!(touching > 0, "{fault}: nothing was touched before");
        if let Some(expected) = expected {
            assert!(
                faults.contains(expected) && (1200..1300).contains(&ticks),
                "{fault}: {:?}",
                faults.names().collect::<Vec<_>>()
            );
        }
    }
}
