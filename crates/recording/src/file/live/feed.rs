//! Which messages leave, and when.

use core::time::Duration;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use foxglove::websocket::{ChannelView, Client, ServerListener};
use foxglove::{Context, FoxgloveError, PartialMetadata, RawChannel, Schema, SinkId};
use rtrb::Consumer;
use tokio::time::MissedTickBehavior;

use super::super::channels::Channel;
use super::super::messages::{self, Occasion, encoded};
use super::super::scene_files::Scenes;
use crate::stamped_record::StampedRecord;
use haptics::Faults;

/// Messages of one topic leave so often at most.
const EVERY: Duration = Duration::from_millis(10);
/// Meshes of a scene that are shown, bytes in all.
const SHOWN_BYTES: u64 = 16 << 20;
/// A client is shown the scene so often when it asks again and again: each time it may wait in
/// memory.
const MOST_SCENES: u32 = 8;
/// Clients of which is known how often they were shown it; more than can be there at once.
const MOST_KNOWN: usize = 64;

/// The topics, as the server has them.
pub(super) struct Channels {
    ticks: Vec<(Channel, Arc<RawChannel>)>,
    faults: Arc<RawChannel>,
    scene: Arc<RawChannel>,
    frame: Arc<RawChannel>,
}

impl Channels {
    pub(super) fn open(context: &Arc<Context>) -> Result<Self, FoxgloveError> {
        let open = |topic: &str, (name, schema): (String, Vec<u8>)| {
            let schema = Schema::new(name, "protobuf", schema);
            context.channel_builder(topic).message_encoding("protobuf").schema(schema).build_raw()
        };
        let on = |occasion: Occasion| open(occasion.topic(), occasion.schema());
        let ticks = Channel::ALL
            .into_iter()
            .map(|channel| Ok((channel, open(channel.topic(), channel.schema())?)));
        Ok(Self {
            ticks: ticks.collect::<Result<_, FoxgloveError>>()?,
            faults: on(Occasion::Faults)?,
            scene: on(Occasion::Scene)?,
            frame: on(Occasion::Frame)?,
        })
    }
}

/// Clients that asked for the scene since the last look.
#[derive(Default)]
pub(super) struct PendingClients(Mutex<Vec<SinkId>>);

impl PendingClients {
    fn take(&self) -> Vec<SinkId> {
        core::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl ServerListener for PendingClients {
    fn on_subscribe(&self, client: Client, channel: ChannelView<'_>) {
        let mut waiting = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(sink) = client.sink_id()
            && channel.topic() == Occasion::Scene.topic()
            && !waiting.contains(&sink)
        {
            waiting.push(sink);
        }
    }
}

/// Takes records and gives messages.
pub(super) struct Feed {
    rows: Consumer<StampedRecord>,
    scenes: Scenes,
    channels: Channels,
    newcomers: Arc<PendingClients>,
    faults: Faults,
    /// Number, stamp and message of the scene that is shown.
    shown: Option<(u32, u64, Vec<u8>)>,
    /// How often each client was shown it.
    greeted: BTreeMap<SinkId, u32>,
    message: Vec<u8>,
}

impl Feed {
    pub(super) fn new(
        rows: Consumer<StampedRecord>,
        scenes: Scenes,
        channels: Channels,
        newcomers: Arc<PendingClients>,
    ) -> Self {
        Self {
            rows,
            scenes,
            channels,
            newcomers,
            faults: Faults::NONE,
            shown: None,
            greeted: BTreeMap::new(),
            message: Vec::new(),
        }
    }

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
                log(&self.channels.faults, row.stamp_ns, || encoded(&messages::faults(&row)));
            }
            if let Some(placement) = row.record.output.object {
                moved.insert(placement.obstacle_idx, row);
            }
            newest = Some(row);
        }
        if let Some(row) = &newest {
            self.show_scene(row);
        }
        // Before the tick that they belong to, or an earlier one.
        moved
            .values()
            .for_each(|row| self.log_ticks(row, |channel| channel == Channel::ObjectPose));
        if let Some(row) = &newest {
            self.log_ticks(row, |channel| channel != Channel::ObjectPose);
            log(&self.channels.frame, row.stamp_ns, || encoded(&messages::frame(row)));
        }
        self.greet();
    }

    fn log_ticks(&mut self, row: &StampedRecord, wanted: impl Fn(Channel) -> bool) {
        for (channel, to) in &self.channels.ticks {
            if wanted(*channel) && to.has_sinks() {
                channel.write(row, &mut self.message);
                to.log_with_meta(&self.message, PartialMetadata::with_log_time(row.stamp_ns));
            }
        }
    }

    /// All clients get another scene when its first tick has come. Its files may be added a little
    /// later.
    fn show_scene(&mut self, row: &StampedRecord) {
        let scene_idx = row.record.scene_idx;
        if self.shown.as_ref().is_some_and(|(shown_idx, ..)| *shown_idx == scene_idx) {
            return;
        }
        if let Some(scene) = self.scenes.get(scene_idx) {
            let message =
                encoded(&messages::scene_update(&scene, scene_idx, row.stamp_ns, SHOWN_BYTES));
            log(&self.channels.scene, row.stamp_ns, || message.clone());
            self.shown = Some((scene_idx, row.stamp_ns, message));
            // They have it, or will be shown it now.
            self.newcomers.take();
        }
    }

    /// A client that connects later gets the current scene.
    fn greet(&mut self) {
        let Some((_, stamp_ns, message)) = &self.shown else { return };
        for sink in self.newcomers.take() {
            let times = self.greeted.entry(sink).or_default();
            *times += 1;
            if *times <= MOST_SCENES {
                let meta = PartialMetadata::with_log_time(*stamp_ns);
                self.channels.scene.log_with_meta_to_sink(message, meta, Some(sink));
            }
        }
        // Numbers of clients grow: the first are those that went first.
        while self.greeted.len() > MOST_KNOWN {
            self.greeted.pop_first();
        }
    }
}

/// Makes a message where a client has subscribed to it.
fn log(channel: &RawChannel, stamp_ns: u64, message: impl FnOnce() -> Vec<u8>) {
    if channel.has_sinks() {
        channel.log_with_meta(&message(), PartialMetadata::with_log_time(stamp_ns));
    }
}
