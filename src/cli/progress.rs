//! Progress of long baking, on a terminal only.

use std::io::IsTerminal;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

use super::{OutputOptions, output};
use crate::scene::BakeEvent;
use vps::storage::printable::one_line;
use vps::voxmap::BakeStage;

/// A line on stderr that says which object is at which stage; silent on a pipe and with `--quiet`.
pub(crate) struct BakeProgress(Option<ProgressBar>);

impl BakeProgress {
    pub(crate) fn new(output: OutputOptions) -> Self {
        let shown = !output.quiet && !output::is_json() && std::io::stderr().is_terminal();
        Self(shown.then(|| {
            let bar = ProgressBar::new_spinner();
            if let Ok(style) = ProgressStyle::with_template("{spinner} baking {msg} ({elapsed})") {
                bar.set_style(style);
            }
            bar.enable_steady_tick(Duration::from_millis(100));
            bar
        }))
    }

    pub(crate) fn tell(&self, event: &BakeEvent<'_>) {
        let Some(bar) = &self.0 else { return };
        let stage = match event.stage {
            BakeStage::Load => "mesh",
            BakeStage::Surface => "surface voxels",
            BakeStage::Fill => "fill",
            BakeStage::Layers => "layers",
            BakeStage::Distance => "distances",
            BakeStage::Pointshell => "pointshell",
        };
        bar.set_message(format!(
            "{} ({} of {}): {stage}",
            one_line(event.name),
            event.object_idx + 1,
            event.n_objects
        ));
    }

    /// Lets someone else write to stderr.
    pub(crate) fn aside(&self, write: impl FnOnce()) {
        match &self.0 {
            Some(bar) => bar.suspend(write),
            None => write(),
        }
    }

    pub(crate) fn finish(self) {
        if let Some(bar) = self.0 {
            bar.finish_and_clear();
        }
    }
}
