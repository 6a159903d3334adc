use core::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Instant;

use glam::DVec3;

use super::super::answer::{Completion, Reply};
use super::super::hub::{Hub, HubParts};
use super::super::worker::Worker;
use super::*;
use crate::config::setting_names::KEYS;
use crate::daemon::sculpting::OrderError;
use crate::daemon::testing;
use clay::PointSet;
use clay::dynamics::Material;
use clay::engine::{EngineError, ToolChange, ToolSettings};
use engine::supervisor::{Notice, Phase};
use rt::clock::ClockKind;
use rt::control::Control;

const HUNG: Duration = Duration::from_secs(60);

/// A view of these samples, 1 mm apart, with a region of 40 mm.
pub(super) fn view_of(points: PointSet, version: u64) -> ClayView {
    ClayView {
        version,
        spacings_m: vec![1e-3; points.len()].into(),
        points: Arc::new(points),
        spacing_m: 1e-3,
        region_map: (DVec3::splat(-0.02), DVec3::splat(0.02)),
        raster: [40; 3],
        curves_map: Arc::default(),
        tool: ToolSettings::default(),
        material: Material::default(),
        is_stroke: false,
        is_unsaved: false,
        is_over: false,
        n_undo: 0,
        n_redo: 0,
        updates: 0,
        update_s: 0.0,
        late: 0,
        trouble: "".into(),
    }
}

/// What it says no with, if it does.
type Refuses = Arc<Mutex<Option<fn() -> OrderError>>>;

/// What happens while the next order is on its way.
type Before = Arc<Mutex<Option<Box<dyn FnOnce() + Send>>>>;

/// A clay that writes down what it is asked, and gives prepared answers.
struct Fake {
    orders: Sender<SculptOrder>,
    before: Before,
    refuses: Refuses,
    view: Arc<Mutex<Option<Arc<ClayView>>>>,
    cancels: Arc<AtomicU64>,
}

impl ClayAccess for Fake {
    fn view(&self) -> Option<Arc<ClayView>> {
        self.view.lock().unwrap().clone()
    }

    fn ask(&self, order: SculptOrder, reply: crate::daemon::sculpting::Reply) {
        let before = self.before.lock().unwrap().take();
        before.into_iter().for_each(|before| before());
        let _ = self.orders.send(order);
        let refuses = *self.refuses.lock().unwrap();
        reply(refuses.map_or(Ok(()), |refused| Err(refused())));
    }

    fn cancel(&self) {
        self.cancels.fetch_add(1, Ordering::Relaxed);
    }
}

struct Bench {
    hub: Arc<Hub>,
    files: Worker,
    orders: Receiver<SculptOrder>,
    before: Before,
    refuses: Refuses,
    view: Arc<Mutex<Option<Arc<ClayView>>>>,
    cancels: Arc<AtomicU64>,
    folder: tempfile::TempDir,
}

fn hub() -> Arc<Hub> {
    let session = testing::session(ClockKind::Real);
    let (enables, _) = crossbeam::channel::unbounded();
    let control = Arc::new(Control::new());
    Hub::new(HubParts {
        session,
        control,
        enables,
        heartbeat: None,
        clock: ClockKind::Real,
        recorder: None,
        metrics: None,
    })
}

fn bench() -> Bench {
    let folder = tempfile::tempdir().unwrap();
    let hub = hub();
    let (sender, orders) = channel();
    let before = Before::default();
    let refuses = Refuses::default();
    let view = Arc::new(Mutex::new(Some(Arc::new(view_of(PointSet::default(), 1)))));
    let cancels = Arc::new(AtomicU64::new(0));
    let access = Box::new(Fake {
        orders: sender,
        before: before.clone(),
        refuses: refuses.clone(),
        view: view.clone(),
        cancels: cancels.clone(),
    });
    let folder_of_clay = Some(folder.path().join("clay"));
    hub.sculpts(ClayParts {
        access,
        world_from_map: Pose::IDENTITY,
        kind: SculptTool::default(),
        folder: folder_of_clay,
        session_at_end: Some("/there/ball.session".into()),
    });
    hub.notice(&Notice::Phase(Phase::Enabled));
    Bench {
        hub,
        files: Worker::new("files").unwrap(),
        orders,
        before,
        refuses,
        view,
        cancels,
        folder,
    }
}

/// What a request comes to.
fn answer_of(ask: impl FnOnce(Reply)) -> Result<Completion, RequestError> {
    let (sender, answers) = channel();
    ask(Box::new(move |result| sender.send(result).unwrap()));
    answers.recv().unwrap()
}

fn took(asked: Value) -> TakeAsked {
    serde_json::from_value(asked).unwrap()
}

impl Bench {
    fn next_order(&self) -> SculptOrder {
        self.orders.try_recv().expect("an order")
    }

    fn facts(&self) -> Value {
        let clay = self.hub.clay().unwrap();
        clay.facts(&clay.view().unwrap(), false)
    }

    /// The next view differs from the one before in this.
    fn shows(&self, change: impl FnOnce(&mut ClayView)) {
        let mut shown = self.view.lock().unwrap();
        let mut view = ClayView::clone(shown.as_ref().expect("a view"));
        change(&mut view);
        *shown = Some(Arc::new(view));
    }

    fn is_held(&self) -> bool {
        self.hub.hold.holds()
    }

    fn hold(&self, client: u64, is_held: bool) -> Result<Completion, RequestError> {
        answer_of(|reply| hold(&self.hub, client, is_held, reply))
    }
}

#[test]
fn a_scene_without_clay_says_so() {
    let hub = hub();
    assert_eq!(
        hub.clay().err().map(|problem| problem.status),
        Some(StatusCode::SERVICE_UNAVAILABLE),
        "still baking"
    );
    hub.notice(&Notice::Phase(Phase::Disabled));
    for result in [
        hub.clay().map(|_| Completion::Nothing),
        answer_of(|reply| take(&hub, took(json!({ "craft": "paint" })), reply)),
        answer_of(|reply| hold(&hub, 1, true, reply)),
        answer_of(|reply| step(&hub, SculptOrder::Undo, "undone", reply)),
        answer_of(|reply| {
            save(&hub, &Worker::new("files").unwrap(), SaveKind::Points, None, reply)
        }),
    ] {
        let problem = result.expect_err("no clay");
        assert_eq!(problem.status, StatusCode::NOT_FOUND);
        assert!(problem.said.hint.contains("hapticd sculpt"), "{problem:?}");
    }
}

#[test]
fn settings_are_asked_for_as_a_change_and_reported_as_the_view_has_them() {
    let bench = bench();
    let asked = json!({ "craft": "paint", "brush_m": 0.003, "color": "#102030" });
    assert_eq!(answer_of(|reply| take(&bench.hub, took(asked), reply)), Ok(Completion::Nothing));
    let expected = ToolChange {
        kind: Some(SculptTool::Paint),
        brush_m: Some(0.003),
        color: Some([0x10, 0x20, 0x30]),
        ..ToolChange::default()
    };
    assert!(matches!(bench.next_order(), SculptOrder::Adjust(change) if change == expected));
    bench.shows(|view| view.tool = expected.onto(&view.tool));
    let facts = bench.facts();
    assert_eq!(
        (&facts["craft"], &facts["brush_m"], &facts["color"]),
        (&json!("paint"), &json!(0.003), &json!("#102030"))
    );
    assert_eq!(facts["crafts"].as_array().map(Vec::len), Some(SculptTool::NAMES.len()));
    assert_eq!(
        facts["painted"],
        json!({ "mass_kg": null, "damping_n_s_per_m": null, "stiffness_n_per_m": null })
    );
    assert_eq!(
        facts["paints"],
        json!({ "mass_kg": null, "damping_n_s_per_m": 5.0, "stiffness_n_per_m": 500.0 })
    );
    assert_eq!(facts["region_map"]["min"], json!([-0.02, -0.02, -0.02]));
    bench.shows(|view| view.tool.painted.mass_kg = Some(1e-4));
    assert_eq!(
        bench.facts()["paints"],
        json!({ "mass_kg": 1e-4, "damping_n_s_per_m": null, "stiffness_n_per_m": null })
    );

    *bench.refuses.lock().unwrap() = Some(|| EngineError::NoShape.into());
    let refused = answer_of(|reply| take(&bench.hub, took(json!({ "craft": "emboss" })), reply))
        .expect_err("refused");
    assert_eq!(
        (refused.status, refused.said.hint),
        (StatusCode::CONFLICT, EngineError::NoShape.hint(&KEYS))
    );
    *bench.view.lock().unwrap() = None;
    assert!(bench.hub.clay().unwrap().view().is_err());
}

#[test]
fn what_is_not_saved_and_what_will_be_is_reported() {
    let bench = bench();
    assert_eq!(
        ["is_unsaved", "session_at_end", "is_over"].map(|key| bench.facts()[key].clone()),
        [json!(false), json!("/there/ball.session"), json!(false)]
    );
    bench.shows(|view| (view.is_unsaved, view.is_over) = (true, true));
    assert_eq!(
        ["is_unsaved", "is_over"].map(|key| bench.facts()[key].clone()),
        [json!(true), json!(true)]
    );
}

#[test]
fn a_hold_ends_with_force_with_the_client_and_when_it_is_let_go() {
    let bench = bench();
    assert_eq!(bench.hold(1, true), Ok(Completion::Nothing));
    assert!(matches!(bench.next_order(), SculptOrder::Hold(true)) && bench.is_held());
    assert_eq!(
        bench.hold(2, true).map_err(|problem| problem.status),
        Err(StatusCode::CONFLICT),
        "one at a time"
    );
    assert_eq!(
        (bench.hold(2, false), bench.is_held()),
        (Ok(Completion::Nothing), true),
        "only one's own"
    );
    assert_eq!(bench.hold(1, false), Ok(Completion::Nothing));
    assert!(matches!(bench.next_order(), SculptOrder::Hold(false)) && !bench.is_held());

    bench.hold(1, true).unwrap();
    assert!(matches!(bench.next_order(), SculptOrder::Hold(true)));
    bench.hub.notice(&Notice::Phase(Phase::Fault));
    assert!(matches!(bench.next_order(), SculptOrder::Hold(false)) && !bench.is_held());
    assert_eq!(
        bench.hold(1, true).map_err(|problem| problem.status),
        Err(StatusCode::CONFLICT),
        "without force"
    );
    assert!(!bench.is_held() && bench.orders.try_recv().is_err());

    bench.hub.notice(&Notice::Phase(Phase::Enabled));
    let watched = bench.hub.clone();
    let watching = std::thread::spawn(move || watched.watch_hold());
    bench.hold(1, true).unwrap();
    assert!(matches!(bench.next_order(), SculptOrder::Hold(true)));
    // The first order to let go is not taken.
    *bench.refuses.lock().unwrap() = Some(|| OrderError::Busy);
    bench.hub.part(1);
    let next = || bench.orders.recv_timeout(HUNG);
    assert!(matches!(next(), Ok(SculptOrder::Hold(false))));
    assert!(matches!(next(), Ok(SculptOrder::Hold(false))), "again");
    *bench.refuses.lock().unwrap() = None;
    let began = Instant::now();
    while bench.is_held() {
        assert!(began.elapsed() < HUNG, "the order to let go was taken");
        std::thread::yield_now();
    }
    bench.hub.end();
    watching.join().unwrap();
}

#[test]
fn a_hold_that_is_asked_for_twice_and_refused_once_is_let_go() {
    let bench = bench();
    bench.hold(1, true).unwrap();
    *bench.refuses.lock().unwrap() = Some(|| OrderError::Busy);
    assert_eq!(
        bench.hold(1, true).map_err(|problem| problem.status),
        Err(StatusCode::TOO_MANY_REQUESTS)
    );
    let orders = [(); 3].map(|()| bench.next_order());
    assert!(
        matches!(
            orders,
            [SculptOrder::Hold(true), SculptOrder::Hold(true), SculptOrder::Hold(false)]
        ),
        "{orders:?}"
    );
    assert!(bench.is_held(), "until the view says that it was let go");
}

#[test]
fn a_hold_that_loses_the_race_with_the_force_is_let_go() {
    let bench = bench();
    // The force goes off between the look at it and the order.
    let racing = bench.hub.clone();
    *bench.before.lock().unwrap() =
        Some(Box::new(move || racing.notice(&Notice::Phase(Phase::Fault))));
    bench.hold(1, true).unwrap();
    let orders = [(); 3].map(|()| bench.next_order());
    assert!(
        matches!(
            orders,
            [SculptOrder::Hold(false), SculptOrder::Hold(true), SculptOrder::Hold(false)]
        ),
        "{orders:?}"
    );
    assert!(!bench.is_held());
}

#[test]
fn files_go_to_one_folder_and_never_over_others() {
    let bench = bench();
    let save = |kind, file: Option<&str>| {
        answer_of(|reply| save(&bench.hub, &bench.files, kind, file.map(str::to_owned), reply))
    };
    let path = bench.folder.path().join("clay/bowl.ply");
    assert_eq!(save(SaveKind::Points, Some("bowl")), Ok(Completion::Saved(path.clone())));
    assert!(matches!(bench.next_order(), SculptOrder::SavePoints(file) if file == path));
    std::fs::write(&path, "kept").unwrap();
    assert_eq!(
        save(SaveKind::Export, Some("bowl.ply")).map_err(|problem| problem.status),
        Err(StatusCode::CONFLICT)
    );
    assert_eq!(
        save(SaveKind::Session, Some("../bowl")).map_err(|problem| problem.status),
        Err(StatusCode::BAD_REQUEST)
    );
    let Ok(Completion::Saved(dated)) = save(SaveKind::Session, None) else {
        panic!("a name of its own")
    };
    assert!(
        matches!(bench.next_order(), SculptOrder::SaveSession(file) if file == dated && dated.to_string_lossy().ends_with(".session"))
    );
}

#[test]
fn a_controlling_client_that_is_lost_cancels_what_takes_long_and_one_that_only_holds_does_not() {
    let bench = bench();
    let hub = bench.hub.clone();
    let watch = std::thread::spawn(move || hub.watch_hold());
    let cancels = || bench.cancels.load(Ordering::Relaxed);
    assert!(bench.hub.hold.hold(3));
    bench.hub.hold.lose(3);
    let next = bench.orders.recv_timeout(HUNG);
    assert!(matches!(next, Ok(SculptOrder::Hold(false))), "it is let go");
    bench.hub.tell_silences();
    assert_eq!(cancels(), 0);
    bench.hub.drive.beat(4, Some(Duration::from_secs(10)), Instant::now());
    bench.hub.drive.lose(4);
    bench.hub.tell_silences();
    assert_eq!(cancels(), 1);
    bench.hub.end();
    watch.join().unwrap();
}
