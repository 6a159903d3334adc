//! `run --console`, `sculpt --console`: commands as lines, from an operator or a program.

use std::io::BufRead;
use std::path::Path;
use std::sync::{Arc, OnceLock};

use crossbeam::channel::{Sender, unbounded};

use super::output;
use crate::config::draft::Unit;
use crate::daemon::sculpting::ClayHandle;
use crate::daemon::session::{HandOrder, SessionError, SessionHandle};
use clay::emboss::GreyImage;
use clay::engine::{ChosenSolid, SculptOrder, SculptTool, ToolChange};
use engine::servo::Control;
use engine::supervisor::Enable;
use vps::storage::printable::one_line;

/// What may be typed.
const WORDS: &str = "enable, disable, stop, restart (the hand), reset (the scene); for clay: tool \
    NAME, image FILE.png or none, solid FILE m|cm|mm|in or none, undo, redo";

/// Begins to take orders from standard input, one a line, in a thread of its own. The end of the
/// input is a stop: the operator has gone. `clay` is set when there is clay. What reads files does
/// so in another thread: a `stop` does not wait for a disk.
///
/// # Errors
/// A thread could not be started.
pub(super) fn begin(
    control: Arc<Control>,
    enables: Sender<Enable>,
    session: SessionHandle,
    clay: Arc<OnceLock<ClayHandle>>,
) -> Result<(), std::io::Error> {
    let (others, waiting) = unbounded::<String>();
    std::thread::Builder::new().name("console-files".to_owned()).spawn(move || {
        for line in waiting {
            match clay_order(&line) {
                Some(order) => ask_clay(order, clay.get(), &line),
                None => output::message(format_args!(
                    "console: `{line}` is not an order; orders are {WORDS}\n"
                )),
            }
        }
    })?;
    let orders = move || read(std::io::stdin().lock(), &control, &enables, &session, &others);
    std::thread::Builder::new().name("console".to_owned()).spawn(orders)?;
    Ok(())
}

/// An order for the clay; `None`: the line is none.
fn clay_order(line: &str) -> Option<Result<SculptOrder, String>> {
    let (word, rest) = line.split_once(' ').map_or((line, ""), |(word, rest)| (word, rest.trim()));
    let change = |change| Ok(SculptOrder::Adjust(change));
    Some(match (word, rest) {
        ("undo", "") => Ok(SculptOrder::Undo),
        ("redo", "") => Ok(SculptOrder::Redo),
        ("tool", name) => match SculptTool::of(name) {
            Some(kind) => change(ToolChange { kind: Some(kind), ..ToolChange::default() }),
            None => Err(format!(
                "no tool is called `{name}`; known: {}",
                SculptTool::NAMES.map(|(name, _)| name).join(", ")
            )),
        },
        ("image", "none") => change(ToolChange { image: Some(None), ..ToolChange::default() }),
        ("image", file) => match GreyImage::read(Path::new(file)) {
            Ok(image) => {
                change(ToolChange { image: Some(Some(Arc::new(image))), ..ToolChange::default() })
            }
            Err(error) => Err(error.to_string()),
        },
        ("solid", "none") => change(ToolChange { solid: Some(None), ..ToolChange::default() }),
        ("solid", rest) => match chosen_solid(rest) {
            Ok(solid) => change(ToolChange { solid: Some(Some(solid)), ..ToolChange::default() }),
            Err(why) => Err(why),
        },
        _ => return None,
    })
}

fn chosen_solid(rest: &str) -> Result<ChosenSolid, String> {
    let split =
        rest.rsplit_once(' ').and_then(|(file, word)| Some((file.trim(), Unit::named(word)?)));
    let (file, unit) = split
        .ok_or_else(|| "give a mesh file and its unit, such as `solid wing.stl mm`".to_owned())?;
    let read = vps::mesh::load_with_notes(Path::new(file), unit.metres())
        .map_err(|error| error.to_string())?;
    let solid = ChosenSolid::centered(read).map_err(|error| format!("{file}: {error}"))?;
    output::message(format_args!("console: solid {file}: {}\n", one_line(&solid.name)));
    Ok(solid)
}

/// Asks the clay.
fn ask_clay(order: Result<SculptOrder, String>, clay: Option<&ClayHandle>, line: &str) {
    let line = line.to_owned();
    let tell = move |what: &dyn std::fmt::Display| {
        output::message(format_args!("console: {line}: {what}\n"))
    };
    match (clay, order) {
        (None, _) => tell(&"this scene has no clay, or it is not ready yet"),
        (_, Err(why)) => tell(&why),
        (Some(clay), Ok(order)) => clay.ask(
            order,
            Box::new(move |result| {
                if let Err(error) = result {
                    tell(&format_args!("{error}; {}", error.hint()));
                }
            }),
        ),
    }
}

/// Carries out what is about force and the scene; other lines go to `others`.
fn read(
    input: impl BufRead,
    control: &Control,
    enables: &Sender<Enable>,
    session: &SessionHandle,
    others: &Sender<String>,
) {
    let tell = |word: &'static str| {
        move |result: Result<(), SessionError>| {
            if let Err(error) = result {
                output::message(format_args!("console: {word}: {error}\n"));
            }
        }
    };
    for line in input.lines() {
        let Ok(line) = line else { break };
        match line.trim() {
            "" => {}
            "disable" | "d" => control.disable(),
            "stop" | "s" => control.stop(),
            // If the run is over, the order is dropped.
            "enable" | "e" => _ = enables.send(Enable(control.permit())),
            "restart" => tell("restart")(session.hand(HandOrder::Restart).map(drop)),
            "reset" => session.reset(Box::new(tell("reset"))),
            line => _ = others.send(line.to_owned()),
        }
    }
    // First the order, then the words.
    control.stop();
    output::message(format_args!("console: the input has ended: stop\n"));
}

#[cfg(test)]
mod tests {
    use crossbeam::channel::bounded;

    use super::*;
    use crate::config::LoadOptions;
    use crate::daemon::testing::{SCENE, scene};
    use engine::servo::Order;
    use rt::clock::ClockKind;

    #[test]
    fn words_become_orders_and_the_end_a_stop() {
        let (control, (sender, enables)) = (Control::enabled(), bounded(16));
        let permit = control.permit();
        let config = scene(SCENE);
        let session = SessionHandle::new(config, LoadOptions::default(), ClockKind::Virtual, None);
        let (others, waiting) = unbounded();
        read(
            "enable\n\n d \nrestart\nreset\nfaster\ntool pull\ne\n".as_bytes(),
            &control,
            &sender,
            &session,
            &others,
        );
        assert_eq!(waiting.try_iter().collect::<Vec<_>>(), ["faster", "tool pull"]);
        let asked: Vec<Enable> = enables.try_iter().collect();
        assert_eq!(asked, [Enable(permit), Enable(control.permit())]);
        assert_ne!(control.permit(), permit, "d took force away");
        assert_eq!(control.renew(permit), None, "the first word is overtaken");
        assert_eq!(control.order(), Order::Stop);
    }

    #[test]
    fn a_tool_an_image_and_a_solid_are_chosen_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name).display().to_string();
        // A file name may have spaces.
        let mesh = at("a block.obj");
        let block =
            vps::mesh::primitives::Shape::Box { size_m: glam::DVec3::new(10.0, 20.0, 30.0) }
                .tessellate(1.0);
        let lines =
            block.vertices.iter().map(|at| format!("v {} {} {}\n", at.x + 50.0, at.y, at.z));
        let faces =
            block.triangles.iter().map(|[a, b, c]| format!("f {} {} {}\n", a + 1, b + 1, c + 1));
        std::fs::write(&mesh, lines.chain(faces).collect::<String>()).unwrap();
        let changed = |line: &str| match clay_order(line) {
            Some(Ok(SculptOrder::Adjust(change))) => change,
            other => panic!("{line}: {other:?}"),
        };
        assert_eq!(changed("tool emboss").kind, Some(SculptTool::Emboss));
        assert_eq!(
            (changed("image none").image, changed("solid none").solid),
            (Some(None), Some(None))
        );
        let image = concat!(env!("CARGO_MANIFEST_DIR"), "/config/models/letter-h.png");
        assert!(matches!(changed(&format!("image {image}")).image, Some(Some(_))));
        let solid = changed(&format!("solid {mesh} mm")).solid.flatten().unwrap();
        assert_eq!(&*solid.name, "12 triangles, 10.0 x 20.0 x 30.0 mm");
        let (low, high) = solid.source.bounds_map(&vps::spatial::Pose::IDENTITY).unwrap();
        assert!((low + high).length() < 1e-12, "{low} {high}");
        assert!(
            matches!(clay_order("undo"), Some(Ok(SculptOrder::Undo)))
                && clay_order("faster").is_none()
        );
        for (line, expected) in [
            ("tool knit", "known: touch"),
            ("image", "cannot read"),
            (&format!("image {mesh}"), "no PNG image"),
            (&format!("solid {mesh}"), "its unit"),
            (&format!("solid {} mm", at("none.stl")), "none.stl"),
        ] {
            let error = clay_order(line).unwrap().expect_err(line);
            assert!(error.contains(expected), "{line}: {error}");
        }
    }
}
