//! Empties the ring of records on a normal thread.

use core::time::Duration;
use std::time::Instant;

use rtrb::Consumer;

use super::{RecordSubscribers, TickRecord};
use haptics::Drive;

/// How long the drain rests when the ring is empty: a ring of some seconds never fills in that
/// time.
const REST: Duration = Duration::from_millis(1);

/// How often a watcher gets a snapshot.
const SNAPSHOT_EVERY: Duration = Duration::from_millis(100);

/// What a watcher gets while records come in.
#[derive(Clone, Copy, Debug)]
pub enum Watch {
    /// The drive changed its state in this record.
    Drive(TickRecord),
    /// A fault appeared in this record.
    Fault(TickRecord),
    /// The first record of another scene.
    Scene(TickRecord),
    /// The newest record, about ten times a second.
    Snapshot(TickRecord),
}

/// Takes records until the producer is gone and the ring is empty, and gives the last one. Blocks;
/// for a thread of its own.
pub fn drain(
    mut records: Consumer<TickRecord>,
    subscribers: &RecordSubscribers,
    mut watch: impl FnMut(Watch),
) -> Option<TickRecord> {
    let mut last: Option<TickRecord> = None;
    let mut next_snapshot = Instant::now() + SNAPSHOT_EVERY;
    loop {
        // Asked before popping: a record that was pushed before the producer went is then always
        // seen.
        let producer_gone = records.is_abandoned();
        let mut n_taken = 0u32;
        while let Ok(record) = records.pop() {
            subscribers.pass(&record);
            let drive_before = last.map_or(Drive::Disabled, |record| record.output.drive);
            let faults_before = last.is_some_and(|record| !record.output.faults.is_empty());
            let scene_before = last.map_or(0, |record| record.scene_idx);
            last = Some(record);
            if record.scene_idx != scene_before {
                watch(Watch::Scene(record));
            }
            if record.output.drive != drive_before {
                watch(Watch::Drive(record));
            }
            if !record.output.faults.is_empty() && !faults_before {
                watch(Watch::Fault(record));
            }
            n_taken += 1;
        }
        if let Some(record) = last
            && n_taken > 0
            && Instant::now() >= next_snapshot
        {
            next_snapshot = Instant::now() + SNAPSHOT_EVERY;
            watch(Watch::Snapshot(record));
        }
        if producer_gone {
            subscribers.close();
            return last;
        }
        if n_taken == 0 {
            std::thread::sleep(REST);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use haptics::{Faults, TickOutput};

    const HUNG: Duration = Duration::from_secs(60);

    #[test]
    fn every_record_is_taken_and_changes_are_reported() {
        let (mut producer, consumer) = rtrb::RingBuffer::new(16);
        for tick in 0..10 {
            let mut output = TickOutput::default();
            if tick >= 3 {
                output.drive = Drive::Enabled;
            }
            if tick >= 7 {
                output.drive = Drive::Fault;
                output.faults = Faults::STALE;
            }
            let scene_idx = u32::from(tick >= 5);
            let record = TickRecord { tick, scene_idx, output, ..TickRecord::default() };
            producer.push(record).expect("room");
        }
        drop(producer);
        let mut reported = Vec::new();
        let subscribers = RecordSubscribers::default();
        let (sender, tapped) = std::sync::mpsc::channel();
        subscribers
            .add(Box::new(move |record| record.tick < 5 && sender.send(record.tick).is_ok()));
        let last = drain(consumer, &subscribers, |watch| match watch {
            Watch::Drive(record) => reported.push((record.tick, "drive")),
            Watch::Fault(record) => reported.push((record.tick, "fault")),
            Watch::Scene(record) => reported.push((record.tick, "scene")),
            Watch::Snapshot(_) => {}
        });
        assert_eq!(reported, [(3, "drive"), (5, "scene"), (7, "drive"), (7, "fault")]);
        assert_eq!(last.map(|record| record.tick), Some(9));
        assert_eq!(tapped.iter().collect::<Vec<_>>(), [0, 1, 2, 3, 4], "until it wants no more");
        subscribers.add(Box::new(|_| panic!("the run is over")));
        assert_eq!(format!("{subscribers:?}"), "RecordSubscribers(0)", "none is taken any more");
    }

    #[test]
    fn a_snapshot_shows_a_new_record_and_comes_at_most_ten_times_a_second() {
        let (mut producer, consumer) = rtrb::RingBuffer::new(256);
        let (sender, snapshots) = std::sync::mpsc::channel();
        let begin = Instant::now();
        let draining = std::thread::spawn(move || {
            drain(consumer, &RecordSubscribers::default(), |watch| {
                if let Watch::Snapshot(record) = watch {
                    let _ = sender.send((record.tick, begin.elapsed()));
                }
            })
        });
        let mut seen: Vec<(u64, Duration)> = Vec::new();
        let mut tick = 0;
        while seen.len() < 3 {
            assert!(begin.elapsed() < HUNG, "{seen:?}");
            // A record that finds the ring full is dropped.
            let _ = producer.push(TickRecord { tick, ..TickRecord::default() });
            tick += 1;
            std::thread::sleep(REST);
            seen.extend(snapshots.try_iter());
        }
        // Nothing comes for a while, and nothing is shown a second time.
        std::thread::sleep(4 * SNAPSHOT_EVERY);
        drop(producer);
        draining.join().expect("no panic");
        seen.extend(snapshots.iter());
        assert!(seen.is_sorted_by(|one, next| one.0 < next.0), "{seen:?}");
        // A busy machine makes them later, never earlier.
        for (n, (_, at)) in (1_u32..).zip(&seen) {
            assert!(*at >= n * SNAPSHOT_EVERY, "{seen:?}");
        }
    }
}
