//! The codec: records of the link's threads.

use core::time::Duration;

use super::super::dialogue::{Question, ask};
use super::super::{Codec, FeedCounts, MotorCommand, Report, StartError};
use super::record::{Heard, heard, put_command};
use crate::transport::{Frame, Transport};

/// How long the service may take for its first state.
const PATIENCE: Duration = Duration::from_secs(2);

/// The host's side.
#[derive(Debug, Default)]
pub(in crate::protocol) struct HostCodec {
    report: Report,
    greeting: String,
}

impl HostCodec {
    fn take(&mut self, record: &[u8]) -> FeedCounts {
        let state = match heard(record) {
            Heard::State(state) => state,
            Heard::Greeting(_) => return FeedCounts::default(),
            Heard::Garbled => return FeedCounts { corrupt: 1, ..FeedCounts::default() },
        };
        self.report.readings[..7].copy_from_slice(&state.pose);
        self.report.buttons = state.buttons;
        self.report.homed = Some(state.homed);
        self.report.error = state.error.into();
        FeedCounts { reports: 1, ..FeedCounts::default() }
    }
}

impl Codec for HostCodec {
    /// A zero command, until the service answers with a state.
    fn start(&mut self, link: &mut dyn Transport) -> Result<(), StartError> {
        let mut zero = Frame::default();
        put_command([0.0; 3], &mut zero);
        let question = Question {
            step: "ask the service for a state",
            frame: zero.as_slice(),
            every: Duration::from_millis(100),
            within: PATIENCE,
        };
        ask(link, &question, |record| match heard(record) {
            Heard::Greeting(text) => {
                self.greeting = text.to_owned();
                None
            }
            _ => (self.take(record).reports > 0).then_some(Ok(())),
        })
    }

    fn feed(&mut self, bytes: &[u8]) -> FeedCounts {
        self.take(bytes)
    }

    fn newest(&self) -> &Report {
        &self.report
    }

    fn encode(&mut self, command: &MotorCommand, frame: &mut Frame) {
        let [x, y, z, ..] = *command.motors();
        put_command([x, y, z], frame);
    }

    fn identity(&self) -> Option<String> {
        self.greeting.lines().next().map(str::to_owned)
    }

    fn notice(&self) -> Option<String> {
        self.greeting.split_once('\n').map(|(_, notice)| notice.to_owned())
    }
}
