//! What every handler can reach.

use std::sync::Arc;

use tokio::sync::Semaphore;

use super::access::Access;
use super::compressed::Compressed;
use super::hub::Hub;
use super::object_cache::ObjectCache;
use super::rate_limiter::RateLimiter;
use super::visual::Visual;
use super::worker::Worker;

/// One for all connections of a server.
pub(super) struct AppState {
    pub(super) hub: Arc<Hub>,
    pub(super) access: Access,
    pub(super) visuals: ObjectCache<Visual>,
    /// Files of structures.
    pub(super) voxels: ObjectCache<Compressed>,
    pub(super) points: ObjectCache<Compressed>,
    /// Makes what is to be drawn.
    pub(super) shapes: Worker,
    /// Reads files for the clay, which may take long.
    pub(super) uploads: Worker,
    /// One at a time.
    pub(super) upload_turn: Arc<Semaphore>,
    pub(super) files: Worker,
    pub(super) seats: Arc<Semaphore>,
    pub(super) rate_limiter: RateLimiter,
}
