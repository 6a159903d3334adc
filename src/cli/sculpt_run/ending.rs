//! After the last tick: waits for the thread of the clay, and keeps what hands made.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::time::{Duration, SystemTime};

use super::super::{OutputOptions, destination, recording, report};
use crate::config::setting_names::KEYS;
use crate::daemon::sculpting::{SculptOutcome, SculptThread};
use clay::engine::{EngineError, SculptEngine, SculptOrder};
use rt::signals::interrupts;
use rt::utc::timestamp;

/// How often the end of the thread is looked for.
const LOOK: Duration = Duration::from_millis(5);

/// Waits for a thread that finishes what it does. A first interrupt is answered with words; a
/// second one ends the wait.
pub(super) fn wait(
    thread: SculptThread,
    output: OutputOptions,
) -> Result<SculptOutcome, (&'static str, &'static str)> {
    thread.end();
    let before = interrupts();
    let mut was_asked = false;
    while !thread.has_ended() {
        match interrupts().wrapping_sub(before) {
            0 => {}
            1 if was_asked => {}
            1 => {
                was_asked = true;
                report::note(
                    "the work on the clay finishes; interrupt once more to end without what it \
                        would save",
                    output,
                );
            }
            _ => {
                return Err((
                    "the work on the clay was not waited for",
                    "what was not saved before is lost",
                ));
            }
        }
        std::thread::sleep(LOOK);
    }
    thread.join().map_err(|why| (why, "this is a bug of hapticd: the clay is lost"))
}

/// An order after the last tick; `None`: the engine panicked. What else there is to be written is
/// not to suffer.
pub(super) fn carry_out(
    engine: &mut SculptEngine,
    order: SculptOrder,
) -> Option<Result<(), EngineError>> {
    catch_unwind(AssertUnwindSafe(|| engine.order(order))).ok()
}

/// Keeps the session where it surely can be written: among what the program keeps for itself, else
/// among temporary files.
pub(super) fn rescue(
    engine: &mut SculptEngine,
    name: &str,
    output: OutputOptions,
) -> Option<PathBuf> {
    let file = format!("{name}-{}-{}.session", timestamp(SystemTime::now()), std::process::id());
    let folders =
        [recording::state_folder().map(|state| state.join("rescued")), Some(std::env::temp_dir())];
    for folder in folders.into_iter().flatten() {
        let path = folder.join(&file);
        if std::fs::create_dir_all(&folder).is_ok()
            && matches!(carry_out(engine, SculptOrder::SaveSession(path.clone())), Some(Ok(())))
        {
            let hint =
                format!("`session = \"{}\"` under [sculpt] goes on from there", path.display());
            report::warning(
                &format!("nothing is lost: the whole session is in {}; {hint}", path.display()),
                output,
            );
            return Some(path);
        }
    }
    report::error(
        "the session could not be kept anywhere",
        Some("free some space on the disk"),
        output,
    );
    None
}

pub(super) fn hint(error: &EngineError) -> String {
    let of_file = match error {
        EngineError::Write { source, .. } => destination::hint(source).map(str::to_owned),
        _ => None,
    };
    of_file.unwrap_or_else(|| error.hint(&KEYS))
}
