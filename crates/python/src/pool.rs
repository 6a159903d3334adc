//! The threads of the module, and a bake that can be interrupted.
//!
//! A process that was forked (`multiprocessing` under Linux before Python 3.14) has none of its
//! parent's threads and would wait for them forever. So the pool belongs to a process: a child
//! makes its own.

use core::ops::ControlFlow;
use core::time::Duration;
use std::panic::{self, AssertUnwindSafe};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use vps::voxmap::BakeStage;

use crate::errors::raise;

/// How long Ctrl-C waits to be noticed.
pub(crate) const SIGNALS_EVERY: Duration = Duration::from_millis(50);

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
/// name of each stage before it begins and the share that is over, at last with "done" and 1, and
/// looks for signals. An exception of `progress`, or a signal's, is raised at once; the bake ends
/// by itself when its current stage is over.
pub(crate) fn bake<T: Send + 'static>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&mut Watch<'_>) -> Result<T, vps::Error> + Send + 'static,
) -> PyResult<T> {
    let pool = pool(py)?;
    let listener = progress.map(|progress| progress.clone().unbind());
    let (tell, stages) = channel();
    let (answer, answers) = channel();
    let (finish, finished) = channel();
    pool.spawn(move || {
        let mut watch = move |stage| match tell.send(stage).ok().and_then(|()| answers.recv().ok())
        {
            Some(()) => ControlFlow::Continue(()),
            None => ControlFlow::Break(()),
        };
        // A panic is raised where the result is awaited; here it would end the process.
        let baked = panic::catch_unwind(AssertUnwindSafe(|| work(&mut watch)));
        // No one waits for a bake that was given up.
        let _ = finish.send(baked);
    });
    let baked = py.detach(move || {
        loop {
            let stage = match stages.recv_timeout(SIGNALS_EVERY) {
                Ok(stage) => Some(stage),
                Err(RecvTimeoutError::Timeout) => None,
                Err(RecvTimeoutError::Disconnected) => break,
            };
            Python::attach(|py| heard(py, listener.as_ref(), stage))?;
            // The bake waits for an answer to each stage, and for nothing else.
            if stage.is_some() && answer.send(()).is_err() {
                break;
            }
        }
        Ok::<_, PyErr>(finished.recv())
    })?;
    match baked {
        Ok(Ok(baked)) => {
            let baked = baked.map_err(raise)?;
            progress.map(|progress| progress.call1(("done", 1.0))).transpose()?;
            Ok(baked)
        }
        Ok(Err(panic)) => panic::resume_unwind(panic),
        Err(_) => Err(PyRuntimeError::new_err("the bake ended without a result")),
    }
}

fn heard(py: Python<'_>, progress: Option<&Py<PyAny>>, stage: Option<BakeStage>) -> PyResult<()> {
    py.check_signals()?;
    if let (Some(progress), Some(stage)) = (progress, stage) {
        progress.call1(py, (name(stage), stage.share()))?;
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
        BakeStage::Field => "field",
        BakeStage::Pointshell => "pointshell",
        BakeStage::Report => "report",
    }
}
