//! Prints what `run --publish` would have sent of a recording: the messages of ROS 2 of some of its
//! ticks, one JSON object on a line.
//!
//! ```text
//! cargo run --release --example ros_messages -- peg.mcap 100 > peg.jsonl     # of every hundredth tick
//! scripts/check-messages peg.mcap peg.jsonl                                  # read by libraries that share no code with hapticd
//! ```

#![expect(clippy::print_stdout, reason = "an example prints its result")]

use std::error::Error;
use std::path::Path;

use link::{Time, Topic, TopicInput};
use recording::file::{Entry, Recording};
use serde_json::json;

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let (Some(file), every) =
        (args.next(), args.next().map_or(Ok(1), |every| every.parse::<u64>())?)
    else {
        return Err("ros_messages FILE.mcap [EVERY]: which recording?".into());
    };
    let mut recording = Recording::open(Path::new(&file))?;
    while let Some(entry) = recording.next_entry()? {
        let Entry::Tick { record, .. } = entry else { continue };
        if !record.tick.is_multiple_of(every.max(1)) {
            continue;
        }
        let sec = record.time_ns / 1_000_000_000;
        let nanosec = record.time_ns % 1_000_000_000;
        let stamp = Time { sec: sec.try_into()?, nanosec: nanosec.try_into()? };
        for topic in Topic::ALL {
            let Some(message) =
                topic.message(&TopicInput { record: &record, stamp, arm: "recorded" })
            else {
                continue;
            };
            let hex: String = message.iter().map(|byte| format!("{byte:02x}")).collect();
            let message_type = topic.message_type();
            let line = json!({ "tick": record.tick, "topic": topic.name(), "type": message_type.ros_name(), "hash": message_type.hash, "hex": hex });
            println!("{line}");
        }
    }
    Ok(())
}
