//! Progress of long baking, on a terminal only.

use std::cell::RefCell;
use std::io::IsTerminal;

use super::{OutputOptions, output};
use crate::scene::BakeEvent;
use vps::storage::printable::one_line;
use vps::voxmap::BakeStage;

/// A line on stderr that says which object is at which stage; silent on a pipe and with `--quiet`.
/// It goes when this is dropped.
pub(crate) struct BakeProgress {
    is_shown: bool,
    line: RefCell<String>,
}

impl BakeProgress {
    pub(crate) fn new(output: OutputOptions) -> Self {
        let is_shown = !output.quiet && !output::is_json() && std::io::stderr().is_terminal();
        Self { is_shown, line: RefCell::default() }
    }

    pub(crate) fn tell(&self, event: &BakeEvent<'_>) {
        let stage = match event.stage {
            BakeStage::Load => "mesh",
            BakeStage::Surface => "surface voxels",
            BakeStage::Fill => "fill",
            BakeStage::Layers => "layers",
            BakeStage::Distance => "distances",
            BakeStage::Field => "sharp edges",
            BakeStage::Pointshell => "pointshell",
            BakeStage::Report => "report",
        };
        let BakeEvent { name, object_idx, n_objects, .. } = event;
        self.show(format!(
            "baking {} ({} of {n_objects}): {stage}",
            one_line(name),
            object_idx + 1
        ));
    }

    /// Lets `write` write to stderr.
    pub(crate) fn aside(&self, write: impl FnOnce()) {
        let line = self.line.borrow().clone();
        self.show(String::new());
        write();
        self.show(line);
    }

    fn show(&self, line: String) {
        if self.is_shown && (!line.is_empty() || !self.line.borrow().is_empty()) {
            output::write_over(&line);
        }
        self.line.replace(line);
    }
}

impl Drop for BakeProgress {
    fn drop(&mut self) {
        self.show(String::new());
    }
}
