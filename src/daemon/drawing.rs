//! Pictures and a film of a run, drawn while it goes on: no display, graphics card or browser is
//! asked for.
//!
//! ```text
//!  drain ──subscriber: which ticks are due──► queue of two ──► thread `pictures`: draws ──► PNG files, the film
//!                                   └ full: left out and counted; under the virtual clock the drain waits
//! ```
//! Data in: every record. Data out: files. Invariants: nothing is drawn on the thread of the loop
//! or of the drain, and under the real clock neither waits; a film has its name when it is whole.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use crossbeam::channel::{Receiver, Sender, TrySendError, bounded};
use serde::Serialize;

use super::session::SessionHandle;
use crate::config::SceneConfig;
use crate::config::scene::MeshSource;
use picture::film::Film;
use picture::parts::{FrameDrawer, SceneParts};
use recording::{RecordSubscribers, TickRecord};
use rt::clock::ClockKind;
use rt::schedule::enter_background;
use vps::mesh::{self, MeshError, TriangleMesh};
use vps::spatial::Pose;
use vps::storage::whole_file::{Access, NewFile, write_bytes};

/// How finely round shapes are cut for a picture, voxels.
const CHORD_VOXELS: f64 = 0.25;
/// From one frame of a film to the next, ns: 25 in a second.
const FRAME_NS: i64 = 40_000_000;
/// Ticks that wait to be drawn: the newest is of more worth than many.
const QUEUE: usize = 2;

/// What is to be drawn of a run.
#[derive(Clone, Debug, Default)]
pub struct DrawingPlan {
    /// Single pictures.
    pub pictures: Option<PicturesPlan>,
    /// File of a film.
    pub video: Option<PathBuf>,
}

/// Single pictures of a run.
#[derive(Clone, Debug)]
pub struct PicturesPlan {
    /// Into this folder, which is there.
    pub folder: PathBuf,
    /// What the files' names begin with.
    pub name: String,
    /// From one to the next; not zero. There is one of the first and one of the last tick besides.
    pub every: Duration,
}

impl PicturesPlan {
    /// The file for a moment of the run.
    pub fn file(&self, time_ns: i64) -> PathBuf {
        self.folder.join(format!("{}-{:09.3}s.png", self.name, time_ns as f64 * 1e-9))
    }

    /// A name that an earlier run may have given.
    pub fn is_own(&self, file_name: &str) -> bool {
        let seconds = file_name
            .strip_prefix(&self.name)
            .and_then(|rest| rest.strip_prefix('-')?.strip_suffix("s.png"));
        seconds.is_some_and(|seconds| {
            seconds.len() >= 9 && seconds.bytes().all(|byte| byte.is_ascii_digit() || byte == b'.')
        })
    }
}

/// What was drawn.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct DrawnSummary {
    /// Single pictures that were written.
    pub pictures: u64,
    /// The film; null when none was asked for, or none could be written.
    pub video: Option<PathBuf>,
    /// Frames that it has.
    pub frames: u64,
    /// Pictures and frames that were left out, as drawing was too slow for them.
    pub left_out: u64,
    /// Why something could not be drawn or written; null when all was.
    pub error: Option<String>,
}

/// A tick to be drawn.
struct DueTick {
    record: TickRecord,
    /// Objects that have moved, by their numbers.
    moved: BTreeMap<u32, Pose>,
    is_picture: bool,
    is_frame: bool,
}

/// Drawing that goes on.
#[derive(Debug)]
pub struct Drawing {
    thread: JoinHandle<DrawnSummary>,
    counts: Arc<Counts>,
}

#[derive(Debug, Default)]
struct Counts {
    has_begun: AtomicBool,
    left_out: AtomicU64,
}

/// Begins to draw what the subscribers get.
///
/// # Errors
/// There is no thread for it.
pub fn begin(
    plan: DrawingPlan,
    session: SessionHandle,
    subscribers: &RecordSubscribers,
    clock: ClockKind,
) -> io::Result<Drawing> {
    let (sender, ticks) = bounded(QUEUE);
    let counts = Arc::new(Counts::default());
    let mut sampler = Sampler {
        sender,
        counts: counts.clone(),
        waits: clock == ClockKind::Virtual,
        picture: plan.pictures.as_ref().map(|pictures| {
            Due::every(i64::try_from(pictures.every.as_nanos()).unwrap_or(i64::MAX))
        }),
        frame: plan.video.as_ref().map(|_| Due::every(FRAME_NS)),
        moved: BTreeMap::new(),
        last: None,
    };
    let drawing =
        DrawingThread { plan, session, scene: None, film: None, drawn: DrawnSummary::default() };
    let thread = std::thread::Builder::new().name("pictures".to_owned()).spawn(move || {
        if clock == ClockKind::Real {
            enter_background();
        }
        drawing.run(&ticks)
    })?;
    subscribers.add(Box::new(move |record| sampler.take(record)));
    Ok(Drawing { thread, counts })
}

impl Drawing {
    /// After the last tick: waits until all is written.
    pub fn end(self) -> DrawnSummary {
        // Without a tick the thread still waits for the first one, and nothing was written.
        let mut drawn =
            match self.counts.has_begun.load(Ordering::Relaxed).then(|| self.thread.join()) {
                Some(Ok(drawn)) => drawn,
                Some(Err(_)) => {
                    let error =
                        Some("the program failed while it drew: please report it".to_owned());
                    DrawnSummary { error, ..DrawnSummary::default() }
                }
                None => DrawnSummary::default(),
            };
        drawn.left_out = self.counts.left_out.load(Ordering::Relaxed);
        drawn
    }
}

/// When the next one is due.
struct Due {
    every_ns: i64,
    /// Which of the times from zero on was the last.
    last: Option<i64>,
}

impl Due {
    fn every(every_ns: i64) -> Self {
        Self { every_ns: every_ns.max(1), last: None }
    }

    /// The first tick, and the first at or after each multiple of the time.
    fn is_due(&mut self, time_ns: i64) -> bool {
        let now = Some(time_ns.div_euclid(self.every_ns));
        core::mem::replace(&mut self.last, now) != now
    }
}

/// On the thread of the drain: looks which ticks are to be drawn.
struct Sampler {
    sender: Sender<DueTick>,
    counts: Arc<Counts>,
    waits: bool,
    picture: Option<Due>,
    frame: Option<Due>,
    moved: BTreeMap<u32, Pose>,
    /// The newest tick, and whether it was sent for a picture and for a frame.
    last: Option<(TickRecord, [bool; 2])>,
}

impl Sampler {
    fn take(&mut self, record: &TickRecord) -> bool {
        self.counts.has_begun.store(true, Ordering::Relaxed);
        if self.last.is_none_or(|(last, _)| last.scene_idx != record.scene_idx) {
            self.moved.clear();
        }
        if let Some(object) = record.output.object {
            self.moved.insert(object.obstacle_idx, object.world_from_map);
        }
        let is_due =
            |due: &mut Option<Due>| due.as_mut().is_some_and(|due| due.is_due(record.time_ns));
        let [is_picture, is_frame] = [is_due(&mut self.picture), is_due(&mut self.frame)];
        self.last = Some((*record, [is_picture, is_frame]));
        if !is_picture && !is_frame {
            return true;
        }
        let due = DueTick { record: *record, moved: self.moved.clone(), is_picture, is_frame };
        if self.waits {
            return self.sender.send(due).is_ok();
        }
        match self.sender.try_send(due) {
            Ok(()) => true,
            Err(TrySendError::Full(_)) => {
                let n = u64::from(is_picture) + u64::from(is_frame);
                self.counts.left_out.fetch_add(n, Ordering::Relaxed);
                self.last = Some((*record, [false; 2]));
                true
            }
            Err(TrySendError::Disconnected(_)) => false,
        }
    }
}

/// The run is over: its last tick is drawn whether it was due or not.
impl Drop for Sampler {
    fn drop(&mut self) {
        let Some((record, [had_picture, had_frame])) = self.last else { return };
        let is_picture = self.picture.is_some() && !had_picture;
        let is_frame = self.frame.is_some() && !had_frame;
        if is_picture || is_frame {
            // A thread that has ended draws nothing.
            let _ = self.sender.send(DueTick {
                record,
                moved: core::mem::take(&mut self.moved),
                is_picture,
                is_frame,
            });
        }
    }
}

/// The scene that is drawn.
struct DrawnScene {
    scene_idx: u32,
    /// Where its static objects stand at the start.
    starts: Vec<Pose>,
    /// `None`: its meshes cannot be read.
    drawer: Option<FrameDrawer>,
}

/// On the thread `pictures`.
struct DrawingThread {
    plan: DrawingPlan,
    session: SessionHandle,
    /// `None` before the first one is loaded.
    scene: Option<DrawnScene>,
    film: Option<(Film<BufWriter<File>>, NewFile)>,
    drawn: DrawnSummary,
}

impl DrawingThread {
    fn run(mut self, ticks: &Receiver<DueTick>) -> DrawnSummary {
        // Before the first tick: reading may take a while.
        self.load(0);
        for due in ticks {
            self.draw(&due);
        }
        if let (Some((film, new)), Some(file)) = (self.film.take(), &self.plan.video) {
            let written = film.finish().and_then(|(mut file, n_frames)| {
                file.flush()?;
                Ok(n_frames)
            });
            let placed = written.and_then(|n_frames| new.place().map(|()| n_frames));
            match placed {
                Ok(n_frames) => {
                    (self.drawn.video, self.drawn.frames) = (Some(file.clone()), n_frames.into())
                }
                Err(error) => fail(&mut self.drawn, file, &error),
            }
        }
        self.drawn
    }

    fn load(&mut self, scene_idx: u32) {
        let config = self.session.config_of(scene_idx);
        let starts =
            config.iter().flat_map(|config| &config.statics).map(|object| object.pose).collect();
        let drawer = match config.map(|config| drawn_parts(&config)) {
            Some(Ok(parts)) => Some(FrameDrawer::new(parts)),
            Some(Err(error)) => {
                self.drawn.error.get_or_insert(error.to_string());
                None
            }
            None => None,
        };
        self.scene = Some(DrawnScene { scene_idx, starts, drawer });
    }

    fn draw(&mut self, DueTick { record, moved, is_picture, is_frame }: &DueTick) {
        if self.scene.as_ref().is_none_or(|scene| scene.scene_idx != record.scene_idx) {
            self.load(record.scene_idx);
        }
        let Some(DrawnScene { starts, drawer: Some(drawer), .. }) = &mut self.scene else { return };
        let place =
            |(idx, start): (usize, &Pose)| moved.get(&(idx as u32)).copied().unwrap_or(*start);
        let world_from_objects: Vec<Pose> = starts.iter().enumerate().map(place).collect();
        let Some(frame) = drawer.frame(record, &world_from_objects) else { return };
        if let Some(pictures) = self.plan.pictures.as_ref().filter(|_| *is_picture) {
            let file = pictures.file(record.time_ns);
            match frame
                .encode_png()
                .map_err(io::Error::other)
                .and_then(|png| write_bytes(&file, &png))
            {
                Ok(()) => self.drawn.pictures += 1,
                Err(error) => {
                    fail(&mut self.drawn, &file, &error);
                    self.plan.pictures = None;
                }
            }
        }
        if let Some(file) = self.plan.video.as_ref().filter(|_| *is_frame) {
            let film = match self.film.take() {
                Some(film) => Ok(film),
                None => NewFile::beside(file, Access::Shared)
                    .map(|(new, file)| (Film::new(BufWriter::new(file)), new)),
            };
            let added = film.and_then(|(mut film, new)| {
                film.add(record.time_ns, frame)?;
                Ok((film, new))
            });
            match added {
                Ok(film) => self.film = Some(film),
                Err(error) => {
                    fail(&mut self.drawn, file, &error);
                    self.plan.video = None;
                }
            }
        }
    }
}

fn fail(drawn: &mut DrawnSummary, file: &Path, error: &io::Error) {
    drawn.error.get_or_insert(format!("cannot write {}: {error}", file.display()));
}

/// The meshes of a scene, as they are drawn: reads the files that it names.
///
/// # Errors
/// A file cannot be read.
pub(crate) fn drawn_parts(config: &SceneConfig) -> Result<SceneParts, MeshError> {
    let loaded = |source: &MeshSource, voxel_size_m: f64| -> Result<TriangleMesh, MeshError> {
        match source {
            MeshSource::File { path, metres_per_unit } => mesh::load(path, *metres_per_unit),
            MeshSource::Shape(shape) => Ok(shape.tessellate(CHORD_VOXELS * voxel_size_m)),
        }
    };
    let statics = config.statics.iter().map(|object| loaded(&object.source, object.voxel_size_m));
    Ok(SceneParts::new(
        statics.collect::<Result<_, _>>()?,
        loaded(&config.tool.source, config.tool.voxel_size_m)?,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sampler(waits: bool, n_queue: usize) -> (Sampler, Receiver<DueTick>) {
        let (sender, ticks) = bounded(n_queue);
        let picture = Some(Due::every(1_000_000_000));
        let frame = Some(Due::every(FRAME_NS));
        (
            Sampler {
                sender,
                counts: Arc::default(),
                waits,
                picture,
                frame,
                moved: BTreeMap::new(),
                last: None,
            },
            ticks,
        )
    }

    fn at(tick: u64) -> TickRecord {
        TickRecord { tick, time_ns: tick as i64 * 1_000_000, ..TickRecord::default() }
    }

    #[test]
    fn ticks_are_drawn_when_they_are_due_and_the_last_one_always() {
        let (mut sampler, ticks) = sampler(false, 1000);
        assert!((0..2011).all(|tick| sampler.take(&at(tick))));
        drop(sampler);
        let ticks: Vec<DueTick> = ticks.iter().collect();
        let times = |is: fn(&DueTick) -> bool| {
            ticks.iter().filter(|due| is(due)).map(|due| due.record.tick).collect::<Vec<_>>()
        };
        assert_eq!(times(|due| due.is_picture), [0, 1000, 2000, 2010]);
        assert_eq!(
            times(|due| due.is_frame),
            (0..=2000).step_by(40).chain([2010]).collect::<Vec<_>>()
        );
    }

    #[test]
    fn a_last_tick_that_is_due_for_a_picture_alone_is_the_last_frame_too() {
        let (mut sampler, ticks) = sampler(false, 1000);
        sampler.picture = Some(Due::every(100_000_000));
        assert!((0..=300).all(|tick| sampler.take(&at(tick))));
        drop(sampler);
        let ticks: Vec<DueTick> = ticks.iter().collect();
        let times = |is: fn(&DueTick) -> bool| {
            ticks.iter().filter(|due| is(due)).map(|due| due.record.tick).collect::<Vec<_>>()
        };
        assert_eq!(times(|due| due.is_picture), [0, 100, 200, 300]);
        assert_eq!(times(|due| due.is_frame), [0, 40, 80, 120, 160, 200, 240, 280, 300]);
    }

    #[test]
    fn under_the_real_clock_a_slow_drawer_delays_nothing_and_what_is_left_out_is_counted() {
        let (mut sampler, ticks) = sampler(false, 2);
        // No thread draws: every call returns at once all the same.
        assert!((0..200).all(|tick| sampler.take(&at(tick))));
        assert_eq!(ticks.len(), 2);
        // Frames at 0 and 40 ms wait, those at 80, 120 and 160 ms are left out; there was one
        // picture, at 0.
        assert_eq!(sampler.counts.left_out.load(Ordering::Relaxed), 3);
        drop(ticks);
        assert!(!sampler.take(&at(200)), "without a drawer there is nothing to subscribe for");
    }

    #[test]
    fn what_has_moved_is_known_until_another_scene_comes() {
        let (mut sampler, ticks) = sampler(false, 10);
        let mut moved = at(1);
        let object = haptics::Placement {
            obstacle_idx: 2,
            world_from_map: Pose::from_translation(glam::DVec3::X),
        };
        moved.output.object = Some(object);
        for record in [at(0), moved, at(40), TickRecord { scene_idx: 1, ..at(80) }] {
            assert!(sampler.take(&record));
        }
        let seen: Vec<usize> = ticks.try_iter().map(|due| due.moved.len()).collect();
        assert_eq!(seen, [0, 1, 0]);
    }

    #[test]
    fn pictures_have_names_that_sort_and_are_known_again() {
        let plan = PicturesPlan {
            folder: PathBuf::from("p"),
            name: "peg".to_owned(),
            every: Duration::from_secs(1),
        };
        assert_eq!(plan.file(12_345_600_000), Path::new("p/peg-00012.346s.png"));
        assert!(plan.file(9_999_000_000) < plan.file(10_000_000_000));
        assert!(
            plan.is_own("peg-00012.346s.png")
                && !plan.is_own("peg-before.png")
                && !plan.is_own("gear-00012.346s.png")
        );
    }
}
