//! Which messages leave, and when.

use core::time::Duration;
use std::collections::BTreeMap;
use std::sync::Arc;

use prost::Message as _;
use rtrb::Consumer;
use tokio::sync::{broadcast, watch};
use tokio::time::MissedTickBehavior;

use super::super::channels::Channel;
use super::super::messages::{self, Occasion};
use super::super::scene_files::Scenes;
use super::{LiveMessage, channel_id, occasion_id};
use crate::stamped_record::StampedRecord;
use haptics::Faults;

/// Messages of one topic leave so often at most.
const EVERY: Duration = Duration::from_millis(10);
/// Meshes of a scene that are shown, bytes in all.
const SHOWN_BYTES: u64 = 16 << 20;

/// Takes records and gives messages.
pub(super) struct Feed {
    pub(super) rows: Consumer<StampedRecord>,
    pub(super) scenes: Scenes,
    pub(super) messages: broadcast::Sender<LiveMessage>,
    /// The scene that is shown.
    pub(super) scene: watch::Sender<Option<LiveMessage>>,
    pub(super) scene_idx: Option<u32>,
    pub(super) faults: Faults,
}

impl Feed {
    /// For ever.
    pub(super) async fn run(mut self) {
        let mut turns = tokio::time::interval(EVERY);
        turns.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            turns.tick().await;
            self.turn();
        }
    }

    fn turn(&mut self) {
        let mut newest = None;
        let mut moved = BTreeMap::new();
        while let Ok(row) = self.rows.pop() {
            let faults = row.record.output.faults;
            if faults != self.faults {
                self.faults = faults;
                self.send(occasion_id(Occasion::Faults), &row, |bytes| {
                    messages::faults(&row).encode_raw(bytes)
                });
            }
            if let Some(placement) = row.record.output.object {
                moved.insert(placement.obstacle_idx, row);
            }
            newest = Some(row);
        }
        let Some(row) = &newest else { return };
        self.show_scene(row);
        // Before the tick that they belong to, or an earlier one.
        moved.values().for_each(|row| self.send_tick(Channel::ObjectPose, row));
        for channel in Channel::ALL {
            if channel != Channel::ObjectPose {
                self.send_tick(channel, row);
            }
        }
        self.send(occasion_id(Occasion::Frame), row, |bytes| {
            messages::frame(row).encode_raw(bytes)
        });
    }

    fn send_tick(&self, channel: Channel, row: &StampedRecord) {
        self.send(channel_id(channel), row, |bytes| channel.write(row, bytes));
    }

    /// Makes a message where there is a client.
    fn send(&self, channel_id: u32, row: &StampedRecord, write: impl FnOnce(&mut Vec<u8>)) {
        if self.messages.receiver_count() > 0 {
            let mut bytes = Vec::new();
            write(&mut bytes);
            // A client that went meanwhile gets nothing.
            let _ = self.messages.send(LiveMessage::new(channel_id, row.stamp_ns, bytes));
        }
    }

    /// All clients get another scene when its first tick has come. Its files may be added a little
    /// later.
    fn show_scene(&mut self, row: &StampedRecord) {
        let scene_idx = row.record.scene_idx;
        if self.scene_idx == Some(scene_idx) {
            return;
        }
        if let Some(scene) = self.scenes.get(scene_idx) {
            self.scene_idx = Some(scene_idx);
            let update = messages::scene_update(&scene, scene_idx, row.stamp_ns, SHOWN_BYTES);
            let id = occasion_id(Occasion::Scene);
            let message = LiveMessage::new(id, row.stamp_ns, update.encode_to_vec());
            self.scene.send_replace(Some(message));
        }
    }
}

impl LiveMessage {
    fn new(channel_id: u32, stamp_ns: u64, bytes: Vec<u8>) -> Self {
        Self { channel_id, stamp_ns, bytes: Arc::new(bytes) }
    }
}
