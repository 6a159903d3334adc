//! The threads of the module, and a bake that can be interrupted.
//!
//! A process that was forked (`multiprocessing` under Linux before Python 3.14) has none of its
//! parent's threads and would wait for them forever. So the pool belongs to a process: a child
//! makes its own.

use core::ops::ControlFlow;
use core::time::Duration;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use vps::voxmap::BakeStage;

use crate::errors::raise;

/// How long Ctrl-C waits to be noticed.
const SIGNALS_EVERY: Duration = Duration::from_millis(50);

/// The pool of this process: as many threads as processors, or as `RAYON_NUM_THREADS` says.
pub(crate) fn pool(_py: Python<'_>) -> PyResult<Arc<ThreadPool>> {
    // Locked with the interpreter's lock held and for no longer than this call, so no fork finds it
    // locked.
    static POOL: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);
    let mut current = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    let process = std::process::id();
    match &*current {
        Some((of, pool)) if *of == process => Ok(Arc::clone(pool)),
        _ => {
            let pool = ThreadPoolBuilder::new().thread_name(|n| format!("vps-{n}")).build();
            let pool = pool.map_err(|error| {
                PyRuntimeError::new_err(format!("cannot start threads: {error}"))
            })?;
            let pool = Arc::new(pool);
            // The parent's pool is left as it is: to drop it would wake threads that are not there.
            core::mem::forget(current.replace((process, Arc::clone(&pool))));
            Ok(pool)
        }
    }
}

/// What the bake calls before each stage.
pub(crate) type Watch<'a> = dyn FnMut(BakeStage) -> ControlFlow<()> + 'a;

/// Runs `work` in the pool without the interpreter's lock. This thread calls `progress` with the
/// name of each stage before it begins, and looks for signals. An exception of `progress`, or a
/// signal's, ends the bake when its current stage is over, and is raised.
pub(crate) fn bake<T: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&mut Watch<'_>) -> Result<T, vps::Error> + Send,
) -> PyResult<T> {
    let pool = pool(py)?;
    let progress = progress.map(|progress| progress.clone().unbind());
    let (tell, stages) = channel();
    let (answer, answers) = channel();
    let (raised, baked) = py.detach(move || {
        let mut raised = None;
        let mut baked = None;
        pool.in_place_scope(|scope| {
            let baked = &mut baked;
            scope.spawn(move |_| {
                let mut watch =
                    move |stage| match tell.send(stage).ok().and_then(|()| answers.recv().ok()) {
                        Some(true) => ControlFlow::Continue(()),
                        _ => ControlFlow::Break(()),
                    };
                *baked = Some(work(&mut watch));
            });
            loop {
                let stage = match stages.recv_timeout(SIGNALS_EVERY) {
                    Ok(stage) => Some(stage),
                    Err(RecvTimeoutError::Timeout) => None,
                    Err(RecvTimeoutError::Disconnected) => break,
                };
                if raised.is_none() {
                    raised = Python::attach(|py| heard(py, progress.as_ref(), stage)).err();
                }
                // The bake waits for an answer to each stage, and for nothing else.
                if stage.is_some() && answer.send(raised.is_none()).is_err() {
                    break;
                }
            }
        });
        (raised, baked)
    });
    match (raised, baked) {
        (Some(raised), _) => Err(raised),
        (None, Some(baked)) => baked.map_err(raise),
        (None, None) => Err(PyRuntimeError::new_err("the bake ended without a result")),
    }
}

fn heard(py: Python<'_>, progress: Option<&Py<PyAny>>, stage: Option<BakeStage>) -> PyResult<()> {
    py.check_signals()?;
    if let (Some(progress), Some(stage)) = (progress, stage) {
        progress.call1(py, (name(stage),))?;
    }
    Ok(())
}

fn name(stage: BakeStage) -> &'static str {
    match stage {
        BakeStage::Load => "load",
        BakeStage::Surface => "surface",
        BakeStage::Fill => "fill",
        BakeStage::Layers => "layers",
        BakeStage::Distance => "distance",
        BakeStage::Pointshell => "pointshell",
    }
}
