//! What the motors of a mock arm do, written down while they do it: for programs that take the time
//! from what they did to zero force.
//!
//! CSV with a header, one line per period in which something but the counts changed, and one after
//! `QUIET` periods without. `t_ns` is `CLOCK_MONOTONIC` at the end of the period.

use std::fs::File;
use std::io::{self, Write};
use std::path::Path;

use vps::storage::whole_file::{Access, NewFile, growing};

/// Lines after which a trace ends: ten minutes in which every millisecond has another force.
const MOST_LINES: u64 = 600_000;

/// Periods after which there is a line without a change: the counts go on.
const QUIET: u64 = 100;

/// What is traced.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TraceSample {
    /// Of the motors, N.
    pub(super) force_n: f64,
    /// Of the motors, N·m.
    pub(super) torque_nm: f64,
    /// Frames of the host so far.
    pub(super) frames: u64,
    /// Periods that began late so far.
    pub(super) late: u64,
    /// Injected faults that are there now.
    pub(super) wrong: usize,
}

/// A trace on its way to a file.
#[derive(Debug)]
pub struct TraceFile {
    file: File,
    last: Option<TraceSample>,
    /// Periods since the last line.
    quiet: u64,
    left: u64,
    ended: Option<io::Error>,
}

impl TraceFile {
    /// Makes the file, in the place of one that is there.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn create(path: &Path) -> io::Result<Self> {
        let (mut file, new) = growing(path, Access::Private, true)?;
        new.map_or(Ok(()), NewFile::place)?;
        file.write_all(b"t_ns,force_n,torque_nm,frames,late,faults\n")?;
        Ok(Self { file, last: None, quiet: 0, left: MOST_LINES, ended: None })
    }

    /// One period. What is written can be read at once.
    pub(super) fn note(&mut self, now_ns: i64, sample: &TraceSample) {
        let is_news = self.last.is_none_or(|last| {
            let same = TraceSample { frames: last.frames, late: last.late, ..*sample };
            same != last || (last.frames == 0) != (sample.frames == 0)
        });
        self.quiet += 1;
        if !is_news && self.quiet < QUIET || self.ended.is_some() {
            return;
        }
        (self.last, self.quiet) = (Some(*sample), 0);
        let TraceSample { force_n, torque_nm, frames, late, wrong } = sample;
        let line = format!("{now_ns},{force_n:.4},{torque_nm:.5},{frames},{late},{wrong}\n");
        self.left -= 1;
        self.ended = match self.file.write_all(line.as_bytes()) {
            Ok(()) if self.left == 0 => Some(io::Error::other(format!(
                "it has {MOST_LINES} lines, and no more are written"
            ))),
            written => written.err(),
        };
    }

    /// Why it does not go to the end, if it does not.
    pub fn ended(&self) -> Option<&io::Error> {
        self.ended.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trace_has_a_line_for_each_change_and_now_and_then_one_without() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("trace.csv");
        let mut trace = TraceFile::create(&path).expect("made");
        let sample = TraceSample { force_n: 0.0, torque_nm: 0.0, frames: 0, late: 0, wrong: 0 };
        trace.note(1, &sample);
        trace.note(2, &TraceSample { late: 1, ..sample });
        trace.note(3, &TraceSample { frames: 4, late: 1, ..sample });
        trace.note(4, &TraceSample { frames: 5, late: 1, ..sample });
        trace.note(5, &TraceSample { force_n: 1.25, frames: 6, late: 1, ..sample });
        trace.note(6, &TraceSample { force_n: 1.25, frames: 7, late: 1, wrong: 1, ..sample });
        trace.note(7, &TraceSample { frames: 7, late: 1, wrong: 1, ..sample });
        for n in 8..8 + QUIET as i64 {
            trace.note(n, &TraceSample { frames: 9, late: 1, wrong: 1, ..sample });
        }
        let text = std::fs::read_to_string(&path).expect("text");
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(
            lines,
            [
                "t_ns,force_n,torque_nm,frames,late,faults",
                "1,0.0000,0.00000,0,0,0",
                "3,0.0000,0.00000,4,1,0",
                "5,1.2500,0.00000,6,1,0",
                "6,1.2500,0.00000,7,1,1",
                "7,0.0000,0.00000,7,1,1",
                "107,0.0000,0.00000,9,1,1",
            ]
        );
        assert!(trace.ended().is_none());
    }

    #[test]
    fn a_trace_is_bounded_and_says_so() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("trace.csv");
        let mut trace = TraceFile { left: 2, ..TraceFile::create(&path).expect("made") };
        for n in 0..5 {
            trace.note(
                n,
                &TraceSample { force_n: n as f64, torque_nm: 0.0, frames: 1, late: 0, wrong: 0 },
            );
        }
        assert_eq!(std::fs::read_to_string(&path).expect("text").lines().count(), 3);
        assert!(
            trace.ended().is_some_and(|error| error.to_string().contains("no more are written"))
        );
        // A disk that is full ends it as well.
        assert!(TraceFile::create(Path::new("/dev/full")).is_err());
    }
}
