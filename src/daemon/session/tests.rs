use std::sync::mpsc::{Receiver, channel};

use super::super::testing::{self, SCENE, scene};
use super::*;
use arms::simulated::{SimArm, SimParameters};
use engine::servo::{Control, RunPlan, ServoLoop, Step};
use haptics::testing::empty_scene;
use recording::RecordSubscribers;
use rt::clock::VirtualClock;

/// A loop over an empty scene, and the session that changes it. Of a real run but for the clock.
struct Run {
    session: SessionHandle,
    servo: ServoLoop<SimArm, VirtualClock>,
}

impl Run {
    fn begin(session: SessionHandle) -> Self {
        let first = empty_scene();
        let commands = session.begin(&first, Vec::new(), true);
        let (records, _) = rtrb::RingBuffer::new(1);
        let control = Arc::new(Control::enabled());
        let servo = ServoLoop::new(
            first,
            SimArm::new(SimParameters::ideal(1e-3)).expect("valid"),
            VirtualClock::default(),
            control,
            RunPlan::default(),
            records,
        );
        Self { session, servo: servo.with_commands(commands) }
    }

    /// Until this scene is rendered.
    fn reach(&mut self, scene_idx: u32) {
        let reached = (0..1_000_000).any(|_| {
            assert_eq!(self.servo.step(), Step::Continue);
            self.session.view().scene_idx == scene_idx
        });
        assert!(reached, "scene {scene_idx} is not rendered");
    }
}

fn empty() -> RenderScene {
    Arc::try_unwrap(empty_scene()).expect("not shared")
}

fn baked() -> (RenderScene, Vec<ObjectReport>) {
    (empty(), Vec::new())
}

/// What becomes of a scene that is asked for by name.
fn switched(session: &SessionHandle, name: &str) -> Receiver<Result<(), SessionError>> {
    let (sender, heard) = channel();
    session.switch(name.to_owned(), Box::new(move |result| sender.send(result).expect("heard")));
    heard
}

/// A folder with `first.toml` and `second.toml`.
fn two_scenes() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for name in ["first.toml", "second.toml"] {
        std::fs::write(folder.path().join(name), SCENE).expect("written");
    }
    folder
}

/// A session that begins with the first scene of the folder.
fn session_in(
    folder: &tempfile::TempDir,
    recorder: Option<Recorder>,
    baker: Baker,
) -> SessionHandle {
    let config =
        config::load(&folder.path().join("first.toml")).unwrap_or_else(|errors| panic!("{errors}"));
    let session = SessionHandle::new(config, LoadOptions::default(), ClockKind::Real, recorder);
    session.begin_baking(baker, Vec::new()).expect("a thread");
    session
}

fn in_folder(baker: Baker) -> (tempfile::TempDir, SessionHandle) {
    let folder = two_scenes();
    let session = session_in(&folder, None, baker);
    (folder, session)
}

fn limit(session: &SessionHandle) -> ParameterSetting {
    let settings = session.view().settings;
    settings
        .into_iter()
        .find(|setting| setting.parameter.name() == "limit_force_n")
        .expect("a parameter")
}

#[test]
fn a_scene_is_answered_when_it_is_sent_and_shown_when_it_is_rendered() {
    let (_folder, session) = in_folder(Box::new(|_| Ok(baked())));
    for asked in [
        session.set("limit_force_n", 1.0),
        session.hand(HandOrder::Restart).map(|_| ()),
        switched(&session, "second").recv().expect("an answer"),
    ] {
        assert!(matches!(asked, Err(SessionError::Baking)), "{asked:?}");
    }
    let mut run = Run::begin(session.clone());
    assert!(
        matches!(switched(&session, "third").recv(), Ok(Err(SessionError::UnknownScene { known, .. })) if known.len() == 2)
    );
    assert!(matches!(switched(&session, "second").recv(), Ok(Ok(()))));
    let view = session.view();
    assert!(
        view.scene_idx == 0 && view.switching_to.is_some_and(|path| path.ends_with("second.toml"))
    );
    assert!(
        matches!(switched(&session, "first").recv(), Ok(Err(SessionError::Busy))),
        "one at a time"
    );
    run.reach(1);
    let view = session.view();
    assert!(view.config.path.ends_with("second.toml") && view.switching_to.is_none());
    assert_eq!(
        (session.sent_file(0), session.sent_file(1)),
        (None, Some(view.config.path.clone()))
    );
    assert!(matches!(switched(&session, "first").recv(), Ok(Ok(()))));
    run.reach(2);
    drop(run);
    assert!(matches!(switched(&session, "second").recv(), Ok(Err(SessionError::Over))));
    assert!(matches!(
        session.set("limit_force_n", 1.0),
        Err(SessionError::Control(ControlError::Over))
    ));
}

#[test]
fn a_scene_is_recorded_as_it_was_before_it_was_baked() {
    let folder = two_scenes();
    let recorder = Recorder::new(RecordSubscribers::default(), true);
    let second = folder.path().join("second.toml");
    let written_meanwhile = Box::new(move |_: &SceneConfig| {
        std::fs::write(&second, "version = 2\n").expect("written");
        Ok(baked())
    });
    let session = session_in(&folder, Some(recorder.clone()), written_meanwhile);
    let n_scenes = || (0..).take_while(|idx| recorder.scenes.get(*idx).is_some()).count();
    let n_before = n_scenes();
    let mut run = Run::begin(session.clone());
    assert!(matches!(switched(&session, "second").recv(), Ok(Ok(()))));
    assert_eq!(n_scenes(), n_before + 1);
    assert_eq!(recorder.scenes.get(n_before as u32).expect("recorded").toml, SCENE);
    run.reach(1);
}

#[test]
fn a_reset_is_recorded_as_what_was_baked_whatever_its_file_says_by_now() {
    let folder = two_scenes();
    let recorder = Recorder::new(RecordSubscribers::default(), true);
    recorder.scenes.add(SceneFiles { toml: SCENE.to_owned(), ..SceneFiles::default() });
    let session = session_in(&folder, Some(recorder.clone()), Box::new(|_| Ok(baked())));
    let mut run = Run::begin(session.clone());
    std::fs::write(folder.path().join("first.toml"), "version = 2\n").expect("written");
    let (sender, heard) = channel();
    session.reset(Box::new(move |result| sender.send(result).expect("heard")));
    assert!(matches!(heard.recv(), Ok(Ok(()))));
    run.reach(1);
    let files = recorder.scenes.get(1).expect("recorded");
    assert!(files.starts_anew && files.toml == SCENE, "{files:?}");
}

#[test]
fn a_bake_that_panics_is_answered_and_ends_no_other() {
    let mut n_baked = 0;
    let (_folder, session) = in_folder(Box::new(move |_| {
        n_baked += 1;
        assert!(n_baked > 1, "a bake that panics on purpose");
        Ok(baked())
    }));
    let _run = Run::begin(session.clone());
    assert!(matches!(switched(&session, "second").recv(), Ok(Err(SessionError::Over))));
    assert!(session.view().switching_to.is_none());
    assert!(matches!(switched(&session, "second").recv(), Ok(Ok(()))));
}

#[test]
fn a_planned_scene_that_cannot_be_baked_ends_no_other() {
    let mut n_baked = 0;
    let baker: Baker = Box::new(move |_| {
        n_baked += 1;
        if n_baked == 1 {
            let source = vps::mesh::MeshError::Empty { path: "a.obj".into() };
            return Err(vps::part::PartError::Mesh { name: "base".to_owned(), source }.into());
        }
        Ok(baked())
    });
    let session = testing::session(ClockKind::Virtual);
    let planned = [10, 20].map(|at_tick| PlannedScene { config: scene(SCENE), at_tick });
    session.begin_baking(baker, planned.into()).expect("a thread");
    let mut run = Run::begin(session.clone());
    run.reach(1);
    assert_eq!((session.planned_scene_idx(0), session.planned_scene_idx(1)), (None, Some(1)));
    assert_eq!(session.take_failed().len(), 1);
}

#[test]
fn parameters_of_a_scene_that_is_gone_are_not_set() {
    let session = testing::session(ClockKind::Virtual);
    session
        .begin_baking(
            Box::new(|_| Ok(baked())),
            vec![PlannedScene { config: scene(SCENE), at_tick: 1 }],
        )
        .expect("a thread");
    let mut run = Run::begin(session.clone());
    let same = scene(SCENE);
    assert!(session.follow_file(0, &same).is_ok());
    run.reach(1);
    assert!(matches!(
        session.follow_file(0, &same),
        Err(SessionError::Control(ControlError::Over))
    ));
    assert!(session.follow_file(1, &same).is_ok());
}

#[test]
fn a_limit_that_was_lowered_bounds_files_and_is_shown_so_in_the_scene_that_comes() {
    let session = testing::session(ClockKind::Virtual);
    session
        .begin_baking(
            Box::new(|_| Ok(baked())),
            vec![PlannedScene { config: scene(SCENE), at_tick: 1 }],
        )
        .expect("a thread");
    let mut run = Run::begin(session.clone());
    let all_n = limit(&session).range.scene;
    assert!(session.set("limit_force_n", 0.5 * all_n).is_ok());
    run.reach(1);
    assert_eq!((limit(&session).value, limit(&session).range.scene), (0.5 * all_n, all_n));
    // The file says less now: no client asks for more than that.
    let mut file = scene(SCENE);
    file.parameters = haptics::testing::parameters();
    file.parameters.limits.force_n = 0.8 * all_n;
    let changes = session.0.state.lock().expect("whole").controls.as_mut().map(|controls| {
        let changes = controls.file_changes(&file.parameters).expect("in range");
        controls.follow_file(&file.parameters, &changes)
    });
    assert!(matches!(changes, Some(Ok(()))));
    assert_eq!((limit(&session).value, limit(&session).range.most), (0.5 * all_n, 0.8 * all_n));
    assert!(session.set("limit_force_n", 0.9 * all_n).is_err());
    assert!(session.set("limit_force_n", 0.7 * all_n).is_ok());
    assert_eq!(limit(&session).value, 0.7 * all_n);
}

#[test]
fn only_parameters_that_can_be_set_are_taken_from_a_file() {
    let changes = |rendered: &str, set: &[(&str, f64)], file: &str| {
        let session =
            SessionHandle::new(scene(rendered), LoadOptions::default(), ClockKind::Real, None);
        let first = RenderScene { parameters: scene(rendered).parameters, ..empty() };
        let _queue = session.begin(&Arc::new(first), Vec::new(), true);
        set.iter().for_each(|(name, value)| session.set(name, *value).expect("in range"));
        session.follow_file(0, &scene(file)).expect("rendered")
    };
    assert_eq!(changes(SCENE, &[], SCENE), Some(Vec::new()));
    let softer = SCENE.replace("= 1.25", "= 1.075\nfriction = { static = 0.3, dynamic = 0.2 }");
    let expected = [
        ("contact_stiffness_n_per_m", 5000.0, 4300.0),
        ("friction_static", 0.0, 0.3),
        ("friction_dynamic", 0.0, 0.2),
    ];
    assert_eq!(
        changes(SCENE, &[], &softer),
        Some(expected.map(|(name, from, to)| FileChange { name, from, to }).to_vec())
    );
    // What a client changed goes back to what the file says.
    let back = FileChange { name: "contact_stiffness_n_per_m", from: 2500.0, to: 5000.0 };
    assert_eq!(changes(SCENE, &[("contact_stiffness_n_per_m", 2500.0)], SCENE), Some(vec![back]));
    for (from, to) in [
        ("[60.0, 60.0]", "[60.0, 50.0]"),
        ("\"base\"", "\"floor\""),
        ("= 1.25", "= 125.0"),
        ("[contact]", "[limits]\nforce_n = 5.0\n[contact]"),
        ("[contact]", "[rendering]\ncoupling = \"constraint\"\n[contact]"),
        ("= 1.25", "= 1.0\nbraking = true"),
    ] {
        assert!(SCENE.contains(from));
        assert_eq!(changes(SCENE, &[], &SCENE.replace(from, to)), None, "{to}");
    }
}
