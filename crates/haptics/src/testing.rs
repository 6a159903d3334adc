//! Stand-ins for tests: the parameters of a scene without objects, and that scene.
#![expect(clippy::disallowed_types, reason = "test code outside the loop")]

use std::sync::Arc;

use glam::{DMat3, DVec3};
use vps::pointshell::shell::Shell;

use crate::{
    CouplingParameters, FilterParameters, Inertia, LimitParameters, Parameters, RenderScene, Tool,
};

/// Parameters of a 1 kHz scene with nothing in it.
pub fn parameters() -> Parameters {
    Parameters {
        coupling: CouplingParameters { stiffness_nm_per_rad: 0.3, ..CouplingParameters::PLAIN },
        filter: FilterParameters { spatial: true, cutoff_hz: [f64::INFINITY, f64::INFINITY] },
        limits: LimitParameters {
            force_n: 10.0,
            torque_nm: 0.2,
            speed_m_per_s: 1.0,
            slew_n_per_s: 1000.0,
            slew_nm_per_s: 20.0,
            power_w: 5.0,
            stall_s: 0.05,
            ..LimitParameters::NONE
        },
        ..Parameters::unlimited(1e-3)
    }
}

/// A scene without objects. The one place to extend when `RenderScene` grows.
pub fn empty_scene() -> Arc<RenderScene> {
    let inertia = Inertia { mass_kg: 0.1, body_kg_m2: DMat3::IDENTITY * 1e-5, least_kg_m2: 1e-5 };
    let tool = Tool { shell: Shell::new(&[], 1e-3), inertia, center_of_mass_tool: DVec3::ZERO };
    Arc::new(RenderScene { parameters: parameters(), obstacles: Vec::new(), clay: None, tool })
}
