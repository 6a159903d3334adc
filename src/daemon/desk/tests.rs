use super::super::testing::{self, SCENE};
use super::*;
use crate::servo::ReinEnds;
use crate::servo::testing::empty_scene;

fn offered() -> (Offered, ReinEnds) {
    let scene = empty_scene();
    let (reins, ends) = Reins::new(&scene.parameters, []);
    (Offered { config: testing::scene(SCENE), scene, reins }, ends)
}

/// A desk that is open, and what else lives as long.
fn desk() -> (Counter, Board, ReinEnds) {
    let (desk, counter, board) = testing::desk();
    let (Offered { config, scene, reins }, ends) = offered();
    desk.serve(config, scene, reins).expect("a thread");
    (counter, board, ends)
}

/// What the desk answers; everything that was said before has been taken then.
fn ask(counter: &Counter, ask: Ask) -> Result<(), Refusal> {
    let (sender, answers) = unbounded();
    counter.ask(Request { ask, answer: Box::new(move |result| drop(sender.send(result))) });
    answers.recv().expect("an answer")
}

fn nothing() -> Ask {
    Ask::Place { object: String::new(), world_from_object: Pose::IDENTITY }
}

#[test]
fn parameters_of_a_scene_that_is_gone_are_not_set() {
    let (counter, board, ends) = desk();
    let Setting { name, range, .. } = board.view().settings[0];
    let set = |scene_idx| ask(&counter, Ask::SetAll { scene_idx, values: vec![(name, range.least)] });
    assert!(matches!(set(0), Ok(())));
    let (offered, others) = offered();
    counter.offered(offered);
    counter.rendered(1);
    assert!(matches!(set(0), Err(Refusal::Tune(TuneError::Over))));
    assert!(matches!(set(1), Ok(())));
    drop((ends, others));
}

#[test]
fn a_scene_is_shown_whether_it_was_offered_or_rendered_first() {
    let (counter, board, _ends) = desk();
    let mut ends = Vec::new();
    let mut offer = || {
        let (offered, its) = offered();
        ends.push(its);
        counter.offered(offered);
    };
    counter.rendered(1);
    offer();
    assert!(ask(&counter, nothing()).is_err());
    assert_eq!(board.view().scene_idx, 1);
    offer();
    offer();
    assert!(ask(&counter, nothing()).is_err());
    assert_eq!(board.view().scene_idx, 1, "offered is not rendered");
    counter.rendered(2);
    counter.rendered(3);
    assert!(ask(&counter, nothing()).is_err());
    assert_eq!(board.view().scene_idx, 3);
}

#[test]
fn a_limit_that_was_lowered_bounds_files_and_is_shown_so_in_the_scene_that_comes() {
    let (counter, board, ends) = desk();
    let knob = |board: &Board| *board.view().settings.iter().find(|setting| setting.name == "limit_force_n").expect("a knob");
    let Setting { name, range, .. } = knob(&board);
    let half = 0.5 * range.scene;
    assert!(matches!(ask(&counter, Ask::Set { parameter: name.to_owned(), value: half }), Ok(())));
    assert!(matches!(ask(&counter, Ask::SetAll { scene_idx: 0, values: vec![(name, range.scene)] }), Ok(())));
    assert_eq!((knob(&board).value, knob(&board).range.scene), (half, range.scene));
    let (coming, others) = offered();
    counter.offered(coming);
    counter.rendered(1);
    assert!(ask(&counter, nothing()).is_err());
    assert_eq!((board.view().scene_idx, knob(&board).value), (1, half));
    // The file says less now: no client asks for more than that.
    assert!(matches!(ask(&counter, Ask::SetAll { scene_idx: 1, values: vec![(name, 0.8 * range.scene)] }), Ok(())));
    assert_eq!((knob(&board).value, knob(&board).range.most), (half, 0.8 * range.scene));
    let raise = |value: f64| ask(&counter, Ask::Set { parameter: name.to_owned(), value });
    assert!(matches!(raise(0.9 * range.scene), Err(Refusal::Tune(TuneError::Range { .. }))));
    assert!(matches!(raise(0.7 * range.scene), Ok(())));
    assert_eq!(knob(&board).value, 0.7 * range.scene);
    drop((ends, others));
}
