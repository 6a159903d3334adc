//! What was made of the objects of a scene for pages, kept while that scene is rendered.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use super::worker::Worker;

/// Number of the scene, and of the object.
type Key = (u32, usize);

/// Things of one kind, one for each object.
#[derive(Debug)]
pub(super) struct ObjectCache<V> {
    worker: Worker,
    kept: Arc<Mutex<HashMap<Key, Arc<V>>>>,
}

impl<V: Send + Sync + 'static> ObjectCache<V> {
    pub(super) fn new(worker: Worker) -> Self {
        Self { worker, kept: Arc::default() }
    }

    /// What was made of an object, or what `make` makes of it now, on the worker. `None`: it has
    /// panicked.
    pub(super) async fn get<E: Send + 'static>(
        &self,
        key @ (scene_idx, _): Key,
        make: impl FnOnce() -> Result<V, E> + Send + 'static,
    ) -> Option<Result<Arc<V>, E>> {
        let find = move |kept: &Mutex<HashMap<_, Arc<V>>>| {
            kept.lock().unwrap_or_else(PoisonError::into_inner).get(&key).cloned()
        };
        if let Some(found) = find(&self.kept) {
            return Some(Ok(found));
        }
        let kept = self.kept.clone();
        let work = move || {
            // Another client may have asked meanwhile.
            if let Some(found) = find(&kept) {
                return Ok(found);
            }
            let made = Arc::new(make()?);
            let mut kept = kept.lock().unwrap_or_else(PoisonError::into_inner);
            kept.retain(|(scene, _), _| *scene == scene_idx);
            kept.insert(key, made.clone());
            Ok(made)
        };
        self.worker.run(work).await
    }
}
