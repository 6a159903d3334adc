//! Whole recordings, without a program around them.

use std::io::Read as _;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;

use glam::{DQuat, DVec3};
use prost::Message as _;

use super::channels::Channel;
use super::*;
use crate::stamped_record::StampedRecord;
use crate::{RecordSubscribers, TickRecord, drain};
use haptics::{
    Drive, DriveRequest, Faults, FrameInUse, LiveParameter, OffCause, ParameterChange, Placement,
    TickInput, TickOutput,
};
use vps::spatial::{DeviceSample, Pose, SampleStatus, Twist, Wrench};

/// A record in which every value differs from its neighbours, some of them in ways that are easily
/// lost.
fn odd_record(tick: u64) -> TickRecord {
    let number = |n: u64| match (tick + n) % 7 {
        0 => f64::from_bits(0x7ff8_0000_0000_0000 | tick << 8 | n),
        1 => -0.0,
        2 => f64::NEG_INFINITY,
        3 => f64::MIN_POSITIVE / 4.0,
        _ => (tick * 100 + n) as f64 * 0.1,
    };
    let vector = |n: u64| DVec3::new(number(n), number(n + 1), number(n + 2));
    let pose = |n: u64| {
        Pose::new(
            DQuat::from_xyzw(number(n), number(n + 1), number(n + 2), number(n + 3)),
            vector(n + 4),
        )
    };
    let wrench = |n: u64| Wrench::new(vector(n), vector(n + 3));
    TickRecord {
        tick,
        scene_idx: u32::from(tick > 5),
        time_ns: tick as i64 * 1_000_003,
        wakeup_ns: tick + 1,
        compute_ns: u64::MAX - tick,
        device_ns: tick + 3,
        input: TickInput {
            sample: DeviceSample {
                pose: pose(1),
                twist: Twist { linear: vector(11), angular: vector(14) },
                grip_rad: number(17),
                buttons: 0x8000_0001,
                sequence: u64::MAX - tick,
                status: [SampleStatus::Fresh, SampleStatus::Stale, SampleStatus::Lost]
                    [tick as usize % 3],
                delay_ticks: 3,
                homed: tick.is_multiple_of(2),
                corrupt_packets: u16::MAX,
                lost_packets: 4,
                device_error: 5,
                overheated: tick.is_multiple_of(3),
            },
            request: [DriveRequest::Disable, DriveRequest::Enable, DriveRequest::Stop]
                [tick as usize % 3],
            overrun: tick.is_multiple_of(5),
            stalled: tick.is_multiple_of(7),
            place: tick
                .is_multiple_of(2)
                .then(|| Placement { obstacle_idx: 3, world_from_map: pose(20) }),
            parameter_change: tick.is_multiple_of(3).then(|| ParameterChange {
                parameter: LiveParameter::ALL[tick as usize % 10],
                value: number(30),
            }),
            clay: tick.is_multiple_of(7).then(|| FrameInUse {
                sequence: u64::MAX - tick,
                is_last: tick.is_multiple_of(14),
            }),
        },
        output: TickOutput {
            command_device: wrench(31),
            commanded_device: wrench(41),
            contact_world: wrench(51),
            world_from_tool: pose(61),
            contacts: 7,
            max_depth_m: number(71),
            depth_is_bound: tick.is_multiple_of(3),
            clearance_m: number(72),
            points_left_out: 8,
            energy_j: number(73),
            object_work_j: number(74),
            objects_moving: 9,
            object: tick
                .is_multiple_of(4)
                .then(|| Placement { obstacle_idx: 5, world_from_map: pose(80) }),
            passivity_active: tick.is_multiple_of(2),
            delay_ticks: 11,
            drive: [
                Drive::Disabled,
                Drive::Enabling,
                Drive::Enabled,
                Drive::Stopping,
                Drive::Fault,
                Drive::Braking,
            ][tick as usize % 6],
            faults: Faults::from_bits((tick % 3) as u32),
            off_cause: OffCause::ALL[tick as usize % 16],
        },
        rendered_device: wrench(90),
        beside_device: wrench(100),
        contact_budget_points: tick.is_multiple_of(2).then_some(1234),
    }
}

/// Every bit of a record.
fn bits(record: &TickRecord) -> Vec<Vec<u8>> {
    let mut message = Vec::new();
    let row = StampedRecord { record: *record, ..StampedRecord::default() };
    Channel::ALL
        .into_iter()
        .filter(|channel| channel.has_message(&row))
        .map(|channel| {
            channel.write(&row, &mut message);
            message.clone()
        })
        .collect()
}

/// Passes records through a drain.
fn feed(subscribers: &RecordSubscribers, records: impl IntoIterator<Item = TickRecord>) {
    let records: Vec<TickRecord> = records.into_iter().collect();
    let (mut producer, consumer) = rtrb::RingBuffer::new(records.len().max(1));
    records.into_iter().for_each(|record| producer.push(record).expect("room"));
    drop(producer);
    drain(consumer, subscribers, |_| ());
}

fn entries(path: &Path) -> (Vec<Entry>, bool) {
    let mut recording = Recording::open(path).expect("a file");
    let mut entries = Vec::new();
    while let Some(entry) = recording.next_entry().expect("a recording") {
        entries.push(entry);
    }
    (entries, recording.is_whole())
}

fn ticks(entries: &[Entry]) -> Vec<(TickRecord, u64)> {
    let tick = |entry: &Entry| {
        if let Entry::Tick { record, dropped } = entry { Some((**record, *dropped)) } else { None }
    };
    entries.iter().filter_map(tick).collect()
}

fn never_fails(error: &RecordingError) {
    panic!("{error}");
}

#[test]
fn every_bit_of_every_tick_comes_back_with_the_files_of_its_scene() {
    let folder = tempfile::tempdir().expect("a folder");
    let mesh = folder.path().join("part.obj");
    std::fs::write(&mesh, "v 0 0 0\n").expect("written");
    let recorder = Recorder::new(RecordSubscribers::default(), true);
    recorder.facts.note("rate_hz", 1000);
    for name in ["first", "second"] {
        recorder.scenes.add(SceneFiles {
            name: name.to_owned(),
            toml: "version = 1".to_owned(),
            named: vec![
                NamedFile::new("part.obj".to_owned(), mesh.clone(), Vec::new()),
                NamedFile::new("gone.obj".to_owned(), folder.path().join("gone.obj"), Vec::new()),
            ],
            shown: vec![DisplayObject {
                name: "part".to_owned(),
                pose: Pose::IDENTITY,
                is_tool: false,
                form: DisplayShape::Mesh(mesh.clone(), 1.0),
            }],
            ..SceneFiles::default()
        });
    }
    let path = folder.path().join("all.mcap");
    let handle = recorder.start(&path, false, Box::new(never_fails)).expect("started");
    feed(recorder.subscribers(), (0..20).map(odd_record));
    let summary = handle.stop();
    assert_eq!((summary.records, summary.dropped, summary.error), (20, 0, None));
    let (entries, is_whole) = entries(&path);
    assert!(is_whole);
    let read = ticks(&entries);
    assert_eq!(read.len(), 20);
    for (tick, (record, dropped)) in (0..).zip(&read) {
        assert_eq!((bits(record), *dropped), (bits(&odd_record(tick)), 0), "{tick}");
        assert_eq!(
            format!("{record:?}"),
            format!("{:?}", odd_record(tick)),
            "a field that no message holds"
        );
    }
    let attachment = |wanted: &str| {
        entries.iter().find_map(|entry| match entry {
            Entry::Attachment { name, data } if name == wanted => Some(data.clone()),
            _ => None,
        })
    };
    assert_eq!(attachment("scenes/0/scene.toml").as_deref(), Some(&b"version = 1"[..]));
    assert_eq!(attachment("scenes/1/files/0/part.obj").as_deref(), Some(&b"v 0 0 0\n"[..]));
    let manifest = entries.iter().find_map(|entry| match entry {
        Entry::Metadata { name, values } if name == "scenes/1" => Some(values.clone()),
        _ => None,
    });
    let manifest = manifest.expect("a manifest");
    assert_eq!(
        (manifest["name"].as_str(), manifest["file.1.written"].as_str()),
        ("second", "gone.obj")
    );
    assert!(manifest["file.1.0.missing"].contains("No such file"), "{manifest:?}");
    // Another recording of the same name is not written over.
    assert!(matches!(
        recorder.start(&path, false, Box::new(never_fails)),
        Err(RecordingError::Exists(_))
    ));
}

#[test]
fn the_meshes_that_viewers_show_share_their_room() {
    let folder = tempfile::tempdir().expect("a folder");
    let mesh = folder.path().join("part.stl");
    std::fs::File::create(&mesh).expect("created").set_len(14 << 20).expect("long");
    let shown = DisplayObject {
        name: "part".to_owned(),
        pose: Pose::IDENTITY,
        is_tool: false,
        form: DisplayShape::Mesh(mesh, 1.0),
    };
    let recorder = Recorder::new(RecordSubscribers::default(), true);
    recorder.scenes.add(SceneFiles { shown: vec![shown; 5], ..SceneFiles::default() });
    let path = folder.path().join("many.mcap");
    let handle = recorder.start(&path, false, Box::new(never_fails)).expect("started");
    feed(recorder.subscribers(), [TickRecord::default()]);
    handle.stop();
    let bytes = std::fs::read(&path).expect("bytes");
    let messages =
        mcap::MessageStream::new(&bytes).expect("mcap").map(|message| message.expect("sound"));
    let scene =
        messages.filter(|message| message.channel.topic == "/scene").last().expect("a scene");
    assert_eq!(scene.data.len() >> 20, 28, "two of five");
}

#[test]
fn what_was_there_stays_until_there_is_something_to_take_its_place() {
    let folder = tempfile::tempdir().expect("a folder");
    let [old, link, new, pipe] =
        ["old.mcap", "link.mcap", "new.mcap", "pipe"].map(|name| folder.path().join(name));
    std::fs::write(&old, "an old one").expect("written");
    std::os::unix::fs::symlink("old.mcap", &link).expect("linked");
    rustix::fs::mkfifoat(rustix::fs::CWD, &pipe, rustix::fs::Mode::RWXU).expect("a pipe");
    let _reader = std::fs::OpenOptions::new().read(true).write(true).open(&pipe).expect("opened");
    let begun = |path: &Path, overwrites| {
        let recorder = Recorder::new(RecordSubscribers::default(), true);
        recorder.scenes.add(SceneFiles::default());
        let handle = recorder.start(path, overwrites, Box::new(never_fails)).expect("started");
        (recorder, handle)
    };
    let names = || {
        let names = std::fs::read_dir(folder.path())
            .expect("a folder")
            .map(|entry| entry.expect("an entry").file_name());
        let mut names: Vec<String> =
            names.map(|name| name.to_string_lossy().into_owned()).collect();
        names.sort();
        names
    };
    for (path, overwrites) in [(&old, true), (&new, false), (&new, true), (&pipe, true)] {
        let (_, handle) = begun(path, overwrites);
        handle.abandon();
        assert_eq!(names(), ["link.mcap", "old.mcap", "pipe"]);
        assert_eq!(std::fs::read(&old).expect("there"), b"an old one");
    }
    // What it leads to may be anything of this user's.
    let recorder = Recorder::new(RecordSubscribers::default(), true);
    for overwrites in [true, false] {
        let refused = recorder.start(&link, overwrites, Box::new(never_fails));
        let Err(refused) = refused else { panic!("refused") };
        assert!(refused.to_string().contains("it is a link to old.mcap"), "{refused}");
    }
    let (recorder, handle) = begun(&old, true);
    feed(recorder.subscribers(), [TickRecord::default()]);
    assert_eq!(handle.stop().records, 1);
    assert_eq!(names(), ["link.mcap", "old.mcap", "pipe"]);
    assert_eq!(ticks(&entries(&old).0).len(), 1);
    let mode = std::fs::metadata(&old).expect("there").permissions().mode();
    assert_eq!(mode & 0o777, 0o600, "only its owner reads it");
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_recording_that_is_cut_off_anywhere_can_be_read_up_to_there() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("cut.mcap");
    let recorder = Recorder::new(RecordSubscribers::default(), true);
    recorder.scenes.add(SceneFiles::default());
    let handle = recorder.start(&path, false, Box::new(never_fails)).expect("started");
    feed(
        recorder.subscribers(),
        (0..3000).map(|tick| TickRecord { scene_idx: 0, ..odd_record(tick) }),
    );
    assert_eq!(handle.stop().error, None);
    let bytes = std::fs::read(&path).expect("bytes");
    let mut n_before = 3000;
    for share in (1..20).rev() {
        std::fs::write(&path, &bytes[..bytes.len() * share / 20]).expect("written");
        let mut recording = Recording::open(&path).expect("a file");
        let mut n_ticks = 0;
        while let Some(entry) = recording.next_entry().expect("what is there is sound") {
            if let Entry::Tick { record, .. } = entry {
                assert_eq!(record.tick, n_ticks);
                n_ticks += 1;
            }
        }
        assert!(!recording.is_whole() && n_ticks <= n_before, "{share}: {n_ticks}");
        n_before = n_ticks;
    }
    // Flipped bytes are refused or read, and nothing else.
    for n in (0..bytes.len()).step_by(bytes.len() / 97) {
        let mut broken = bytes.clone();
        broken[n] ^= 0x55;
        std::fs::write(&path, &broken).expect("written");
        // What the file is by its first bytes is asked first.
        let Ok(mut recording) = Recording::open(&path) else { continue };
        while let Ok(Some(_)) = recording.next_entry() {}
    }
}

/// A recording of one message in a chunk, packed.
fn packed(
    topic: &str,
    write: impl FnOnce(&mut mcap::Writer<std::io::Cursor<Vec<u8>>>, u16),
) -> Vec<u8> {
    let options = mcap::WriteOptions::new().compression(Some(mcap::Compression::Lz4));
    let mut writer = options.create(std::io::Cursor::new(Vec::new())).expect("created");
    let channel = writer.add_channel(0, topic, "protobuf", &Default::default()).expect("added");
    write(&mut writer, channel);
    writer.finish().expect("finished");
    writer.into_inner().into_inner()
}

#[test]
fn garbage_is_refused_and_never_panics() {
    // Every optional field is there.
    let row = StampedRecord { record: odd_record(84), ..StampedRecord::default() };
    let mut whole = Vec::new();
    for channel in Channel::ALL {
        channel.write(&row, &mut whole);
        for n in 0..whole.len() {
            for byte in [0, 0x7f, 0x80, 0xff] {
                let mut broken = whole.clone();
                broken[n] = byte;
                for bytes in [&broken[..], &broken[..n]] {
                    let _ = channel.read(bytes, &mut StampedRecord::default());
                }
            }
        }
    }
    let why = |channel: Channel, bytes: &[u8]| {
        channel.read(bytes, &mut StampedRecord::default()).expect_err("refused").to_string()
    };
    assert_eq!(why(Channel::CommandWrench, &[5 << 3, 9]), "there is no Drive 9");
    assert_eq!(why(Channel::DeviceSample, &[10 << 3, 0x80, 0x80, 4]), "65536 is above 65535");
    let number_for_a_pose = why(Channel::DeviceSample, &[1 << 3, 1]);
    assert!(number_for_a_pose.contains("DeviceSample.pose"), "{number_for_a_pose}");
}

#[test]
fn messages_and_schemas_are_those_of_version_0_1_0() {
    for fixture in ["block-on-plane", "lift-with-block"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join(format!("../../tests/fixtures/{fixture}.mcap"));
        let bytes = std::fs::read(path).expect("a fixture");
        let mut written = Vec::new();
        let mut described = Vec::new();
        let mut n_messages = 0;
        for message in mcap::MessageStream::new(&bytes).expect("a recording") {
            let message = message.expect("a message");
            let Some(channel) = Channel::of_topic(&message.channel.topic) else { continue };
            let mut row = StampedRecord { stamp_ns: message.log_time, ..StampedRecord::default() };
            channel.read(&message.data, &mut row).expect("it was sound");
            channel.write(&row, &mut written);
            // Later versions add fields at the end.
            assert!(
                written.starts_with(&message.data),
                "{fixture}: {}: {written:?} for {:?}",
                channel.topic(),
                message.data
            );
            n_messages += 1;
            if described.contains(&channel) {
                continue;
            }
            described.push(channel);
            let schema = message.channel.schema.as_ref().expect("a schema");
            let (name, data) = channel.schema();
            assert_eq!(schema.name, name);
            let types = |data: &[u8]| {
                let set = prost_types::FileDescriptorSet::decode(data).expect("descriptors");
                set.file.into_iter().flat_map(|file| file.message_type)
            };
            for known in types(&schema.data) {
                let now = types(&data)
                    .find(|now| now.name == known.name)
                    .expect("the type is still there");
                assert!(now.field.starts_with(&known.field), "{fixture}: {}", known.name());
            }
        }
        assert!(n_messages > 1000, "{fixture}: {n_messages}");
    }
}

#[test]
fn a_message_that_is_longer_than_any_is_refused() {
    let message = |n_fields: usize| {
        // Field 1, a number, again and again.
        let data = [0x08, 0x00].repeat(n_fields);
        packed("/loop/timing", |writer, channel_id| {
            let header = mcap::records::MessageHeader {
                channel_id,
                sequence: 0,
                log_time: 0,
                publish_time: 0,
            };
            writer.write_to_known_channel(&header, &data).expect("written");
        })
    };
    let first = |bytes: Vec<u8>| {
        Recording::of(std::io::Cursor::new(bytes), Path::new("x.mcap")).next_entry()
    };
    assert!(matches!(first(message(100)), Ok(Some(Entry::Tick { .. }))));
    let error = first(message(1 << 20)).expect_err("refused").to_string();
    assert!(error.contains("a message of /loop/timing is garbled"), "{error}");
}

/// A chunk with a record that begins so and goes on with zeros, packed by hand: an LZ4 frame of one
/// block.
fn chunk_of_zeros(head: &[u8], n_zeros: usize) -> Vec<u8> {
    let length = |block: &mut Vec<u8>, more: usize| {
        block.extend(vec![255; more / 255]);
        block.push((more % 255) as u8);
    };
    // What it begins with and a first zero; that zero again and again; the last five as they are.
    let mut block = vec![0xFF];
    length(&mut block, head.len() + 1 - 15);
    block.extend(head);
    block.extend([0, 1, 0]);
    length(&mut block, n_zeros - 1 - 5 - 19);
    block.extend([0x50, 0, 0, 0, 0, 0]);
    let mut frame = vec![0x04, 0x22, 0x4D, 0x18, 0x60, 0x70, 0x73];
    frame.extend((block.len() as u32).to_le_bytes());
    frame.extend(&block);
    frame.extend([0; 4]);
    let mut chunk = vec![0; 16];
    chunk.extend(((head.len() + n_zeros) as u64).to_le_bytes());
    chunk.extend([0, 0, 0, 0, 3, 0, 0, 0]);
    chunk.extend(b"lz4");
    chunk.extend((frame.len() as u64).to_le_bytes());
    chunk.extend(&frame);
    [&[0x06][..], &(chunk.len() as u64).to_le_bytes(), &chunk].concat()
}

#[test]
fn what_unpacks_to_more_than_the_file_is_refused() {
    // Others would not put an attachment into a chunk.
    let name = b"scenes/0/scene.toml";
    let n_bytes = 1_usize << 20;
    let mut head = vec![0x09];
    head.extend(((16 + 4 + name.len() + 4 + 8 + n_bytes + 4) as u64).to_le_bytes());
    head.extend([0; 16]);
    head.extend((name.len() as u32).to_le_bytes());
    head.extend(name);
    head.extend([0; 4]);
    head.extend((n_bytes as u64).to_le_bytes());
    let bytes = [&b"\x89MCAP0\r\n"[..], &chunk_of_zeros(&head, n_bytes + 4)].concat();
    assert!(bytes.len() < 5000);
    let mut recording = Recording::of(std::io::Cursor::new(bytes), Path::new("x.mcap"));
    let error = recording.next_entry().expect_err("refused").to_string();
    assert!(error.contains("more than it is long"), "{error}");
}

#[test]
fn a_disk_that_takes_nothing_costs_records_and_delays_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("pipe.mcap");
    rustix::fs::mkfifoat(rustix::fs::CWD, &path, rustix::fs::Mode::RWXU).expect("a pipe");
    // Opened by a reader that does not read: the pipe takes 64 KiB and no more.
    let mut reader =
        std::fs::OpenOptions::new().read(true).write(true).open(&path).expect("opened");
    let recorder = Recorder::new(RecordSubscribers::default(), false);
    recorder.scenes.add(SceneFiles::default());
    let handle = recorder.start(&path, true, Box::new(never_fails)).expect("started");
    feed(
        recorder.subscribers(),
        (0..30_000).map(|tick| TickRecord { scene_idx: 0, ..odd_record(tick) }),
    );
    let stuck = handle.status();
    assert!(stuck.dropped > 10_000 && stuck.records < 20_000, "{stuck:?}");
    // Now a reader reads, and what was kept arrives with its gap.
    let out = folder.path().join("out.mcap");
    let copy = out.clone();
    let reading = std::thread::spawn(move || {
        let mut bytes = Vec::new();
        let mut buffer = vec![0; 1 << 16];
        while !bytes.ends_with(b"\x89MCAP0\r\n") || bytes.len() < 100 {
            let n = reader.read(&mut buffer).expect("bytes");
            bytes.extend_from_slice(&buffer[..n]);
        }
        std::fs::write(copy, bytes).expect("written");
    });
    let summary = handle.stop();
    reading.join().expect("read");
    assert_eq!(summary.error, None);
    let (entries, is_whole) = entries(&out);
    let read = ticks(&entries);
    assert!(is_whole);
    assert_eq!((read.len() as u64, read.len() as u64 + summary.dropped), (summary.records, 30_000));
}

#[test]
fn an_error_is_reported_once_and_ends_the_recording_only() {
    let recorder = Recorder::new(RecordSubscribers::default(), false);
    assert!(matches!(
        recorder.start(Path::new("/dev/full"), true, Box::new(never_fails)),
        Err(RecordingError::Write { .. })
    ));
    assert!(matches!(
        recorder.start(Path::new("/proc/f.mcap"), false, Box::new(never_fails)),
        Err(RecordingError::Create { .. })
    ));
    // A reader that goes away in the middle: every write fails from then on.
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("pipe.mcap");
    rustix::fs::mkfifoat(rustix::fs::CWD, &path, rustix::fs::Mode::RWXU).expect("a pipe");
    let reader = std::fs::OpenOptions::new().read(true).write(true).open(&path).expect("opened");
    let (reported, heard) = std::sync::mpsc::channel();
    let handle = recorder
        .start(&path, true, Box::new(move |error| reported.send(error.to_string()).expect("heard")))
        .expect("started");
    drop(reader);
    feed(
        recorder.subscribers(),
        (0..9000).map(|tick| TickRecord { scene_idx: 0, ..odd_record(tick) }),
    );
    let summary = handle.stop();
    let message = heard.recv().expect("reported");
    assert!(
        message.contains("cannot write") && summary.error.as_ref() == Some(&message),
        "{summary:?}"
    );
    assert!(heard.recv().is_err(), "reported once");
}
