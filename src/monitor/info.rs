//! What the supervisor has reported of the run: where it stands, its machine and its arm.

use std::path::PathBuf;

use serde_json::{Value, json};

use super::encode::LastFault;
use crate::config::SceneConfig;
use engine::supervisor::Phase;
use haptics::Faults;
use rt::preflight::PreflightReport;
use vps::spatial::Axes;

/// Version of the API.
pub(super) const API: u32 = 1;

/// What holds until the next report.
#[derive(Debug)]
pub(super) struct RunInfo {
    pub(super) phase: Phase,
    /// The checks of the machine, as clients see them.
    realtime: Vec<Value>,
    /// Where a real arm is attached.
    pub(super) node: Option<PathBuf>,
    /// How its link is.
    pub(super) link: &'static str,
    /// Until the next enable: what acknowledged it may have been a program.
    pub(super) last_fault: Option<LastFault>,
}

impl Default for RunInfo {
    fn default() -> Self {
        Self {
            phase: Phase::Init,
            realtime: Vec::new(),
            node: None,
            link: "unknown",
            last_fault: None,
        }
    }
}

impl RunInfo {
    /// The machine was checked.
    pub(super) fn checked(&mut self, report: &PreflightReport) {
        let rows = report.rows.iter();
        let rows = rows.map(|row| json!({ "name": row.name, "outcome": row.outcome.name(), "found": row.found, "hint": row.hint }));
        self.realtime = rows.collect();
    }

    /// `/api/v1/info`, as far as it is about this and the scene.
    pub(super) fn info(&self, config: &SceneConfig) -> Value {
        let profile = &config.device.profile;
        let six = |axes: Axes| [0, 1, 2, 3, 4, 5].map(|axis| axes.has(axis));
        json!({
            "version": env!("CARGO_PKG_VERSION"),
            "api": API,
            "name": config.name,
            "scene": config.path.to_string_lossy(),
            "rate_hz": config.rate_hz,
            "phase": self.phase.name(),
            "device": {
                "profile": profile.name,
                "title": profile.title,
                "simulated": profile.real.is_none(),
                "sensed": six(profile.sensed),
                "actuated": six(profile.actuated),
                "node": self.node.as_ref().map(|node| node.to_string_lossy()),
                "link": if profile.real.is_none() { "simulated" } else { self.link },
            },
            "limits": {
                "force_n": config.parameters.limits.force_n,
                "torque_nm": config.parameters.limits.torque_nm,
                "speed_m_per_s": config.parameters.limits.speed_m_per_s,
            },
            "deadman": config.parameters.safety.deadman,
            "heartbeat_ms": config.heartbeat.map(|longest| longest.as_millis() as u64),
            "realtime": self.realtime,
            "faults": Faults::TABLE.map(|(_, name, text)| json!({ "name": name, "text": text })),
        })
    }
}

/// Whether force may flow in a phase.
pub(super) fn has_force(phase: Phase) -> bool {
    matches!(phase, Phase::Enabling | Phase::Enabled | Phase::Stopping | Phase::Braking)
}
