//! Ranges and cross-checks of what every arm has. What only real arms have is in `wiring`, `joints`
//! and `packet`.

use std::path::Path;

use super::written::{CodecWord, ProfileFile};
use super::{Link, Plant, Profile, ProfileLimits, ceilings, wiring};
use crate::Pacing;
use document::{
    Checks, ConfigErrors, Document, FINITE, Interval, NOT_NEGATIVE, POSITIVE, ProblemKind, nearest,
};
use vps::spatial::Axes;

/// Checks a profile as it is written; files that it names are looked up in `dir`.
pub(super) fn profile(
    document: &Document<'_>,
    dir: &Path,
    written: &ProfileFile,
) -> Result<Profile, ConfigErrors> {
    let mut checks = Checks::new(document);
    let ProfileFile { device, link, limits, signal, plant, .. } = written;

    let name = device.name.clone().filter(|name| !name.is_empty());
    let name = checks.given("device.name", name, "the name that scenes write").unwrap_or_default();
    let codec = checks.given(
        "device.codec",
        device.codec,
        "the protocol that the arm speaks, or \"sim\" for a simulated arm",
    );
    let sensed = axes(&mut checks, "device.sensed", device.sensed.as_deref());
    let actuated = axes(&mut checks, "device.actuated", device.actuated.as_deref());
    if !sensed.contains(actuated) {
        let sensed: Vec<&str> = sensed.names().collect();
        checks.not_accepted(
            "device.actuated",
            format_args!("a subset of device.sensed, {}", sensed.join(" ")),
        );
    }

    let force_n = limit(
        &mut checks,
        "limits.force_n",
        limits.force_n,
        actuated,
        Axes::TRANSLATION,
        (ceilings::FORCE_N, "N"),
    );
    let torque_nm = limit(
        &mut checks,
        "limits.torque_nm",
        limits.torque_nm,
        actuated,
        Axes::ROTATION,
        (ceilings::TORQUE_NM, "N·m"),
    );
    let damping = NOT_NEGATIVE.to(ceilings::DAMPING_N_S_PER_M).unit("N·s/m");
    let damping_rotation = NOT_NEGATIVE.to(ceilings::DAMPING_NM_S_PER_RAD).unit("N·m·s/rad");
    let limits = ProfileLimits {
        force_n,
        torque_nm,
        stiffness_n_per_m: checks.optional(
            "limits.stiffness_n_per_m",
            limits.stiffness_n_per_m,
            POSITIVE.to(ceilings::STIFFNESS_N_PER_M).unit("N/m"),
        ),
        stiffness_nm_per_rad: checks.optional(
            "limits.stiffness_nm_per_rad",
            limits.stiffness_nm_per_rad,
            POSITIVE.to(ceilings::STIFFNESS_NM_PER_RAD).unit("N·m/rad"),
        ),
        damping_n_s_per_m: checks.optional(
            "limits.damping_n_s_per_m",
            limits.damping_n_s_per_m,
            damping,
        ),
        damping_nm_s_per_rad: checks.optional(
            "limits.damping_nm_s_per_rad",
            limits.damping_nm_s_per_rad,
            damping_rotation,
        ),
        workspace_radius_m: checks.required(
            "limits.workspace_radius_m",
            limits.workspace_radius_m,
            POSITIVE.to(ceilings::WORKSPACE_RADIUS_M).unit("m"),
        ),
    };

    let accepted = "what sets the rate: \"ping-pong\", \"stream\" or \"event\"";
    let pacing = checks.given("link.pacing", link.pacing, accepted);
    let accepted = "true or false: whether the motors keep the last command when the link closes";
    let holds_last_command =
        checks.given("link.holds_last_command", link.holds_last_command, accepted);
    let link = Link {
        pacing: pacing.map_or(Pacing::Stream, Into::into),
        rate_hz: checks.whole("link.rate_hz", link.rate_hz, 1000, 1, 10_000),
        device_watchdog_ms: link.device_watchdog_ms.map(|ms| {
            checks.whole("link.device_watchdog_ms", Some(ms), 100, 1, ceilings::WATCHDOG_MS)
        }),
        holds_last_command: holds_last_command.unwrap_or(true),
    };

    let window = Interval::from(0.0).to(1000.0).unit("ms");
    let velocity_window_ms = checks
        .array("signal.velocity_window_ms", signal.velocity_window_ms, window)
        .unwrap_or([15.0, 30.0]);

    let plant = Plant {
        mass_kg: checks.required(
            "plant.mass_kg",
            plant.mass_kg,
            POSITIVE.to(ceilings::MASS_KG).unit("kg"),
        ),
        damping_n_s_per_m: checks.required(
            "plant.damping_n_s_per_m",
            plant.damping_n_s_per_m,
            damping,
        ),
        inertia_kg_m2: checks.required(
            "plant.inertia_kg_m2",
            plant.inertia_kg_m2,
            POSITIVE.to(ceilings::INERTIA_KG_M2).unit("kg·m²"),
        ),
        damping_nm_s_per_rad: checks.required(
            "plant.damping_nm_s_per_rad",
            plant.damping_nm_s_per_rad,
            damping_rotation,
        ),
        coulomb_n: checks.required(
            "plant.coulomb_n",
            plant.coulomb_n,
            NOT_NEGATIVE.to(ceilings::FORCE_N).unit("N"),
        ),
        coulomb_nm: checks.required(
            "plant.coulomb_nm",
            plant.coulomb_nm,
            NOT_NEGATIVE.to(ceilings::TORQUE_NM).unit("N·m"),
        ),
        encoder_step_m: checks.required(
            "plant.encoder_step_mm",
            plant.encoder_step_mm,
            NOT_NEGATIVE.to(ceilings::ENCODER_STEP_MM).unit("mm"),
        ) * 1e-3,
        encoder_step_rad: checks.required(
            "plant.encoder_step_rad",
            plant.encoder_step_rad,
            NOT_NEGATIVE.to(ceilings::ENCODER_STEP_RAD).unit("rad"),
        ),
        delay_ticks: checks.whole("plant.delay_ticks", plant.delay_ticks, 1, 0, 100),
    };
    let title = device.title.clone().unwrap_or_else(|| name.clone());
    let mut profile = Profile {
        name,
        source: None,
        title,
        sensed,
        actuated,
        limits,
        link,
        velocity_window_ms,
        plant,
        real: None,
    };
    match codec {
        Some(CodecWord::Sim) => refuse_real(&mut checks, written),
        Some(codec) => {
            profile.real = wiring::real_arm(&mut checks, dir, written, codec, &profile);
            bounded_stiffness(&mut checks, &profile);
        }
        None => {}
    }
    checks.finish()?;
    Ok(profile)
}

/// Only a simulated arm may be ideal: without a declared stiffness a scene could ask for any.
fn bounded_stiffness(checks: &mut Checks<'_>, profile: &Profile) {
    let any = |axes: Axes| (0..7).any(|axis| axes.has(axis) && profile.actuated.has(axis));
    if any(Axes::TRANSLATION) && profile.limits.stiffness_n_per_m.is_none() {
        checks.missing(
            "limits.stiffness_n_per_m",
            "the largest stiffness that the arm renders, N/m; if unknown, 300",
        );
    }
    if any(Axes::ROTATION) && profile.limits.stiffness_nm_per_rad.is_none() {
        checks.missing(
            "limits.stiffness_nm_per_rad",
            "the largest stiffness that the arm renders, N·m/rad; if unknown, 0.1",
        );
    }
}

/// Tables that a simulated arm has no use for.
fn refuse_real(checks: &mut Checks<'_>, written: &ProfileFile) {
    let ProfileFile {
        device,
        matching,
        protocol,
        link,
        frame,
        homing,
        geometry,
        joint,
        motors,
        safety,
        identified,
        packet,
        check,
        ..
    } = written;
    let tables = [
        ("device.kinematics", device.kinematics.is_some()),
        ("device.signs_verified", device.signs_verified.is_some()),
        ("match", matching.is_some()),
        ("protocol", protocol.is_some()),
        ("link.watchdog_latched", link.watchdog_latched.is_some()),
        ("link.current_limit_ma", link.current_limit_ma.is_some()),
        ("link.command_limit", link.command_limit.is_some()),
        ("link.saturates_by", link.saturates_by.is_some()),
        ("link.kick_ms", link.kick_ms.is_some()),
        ("frame", frame.is_some()),
        ("homing", homing.is_some()),
        ("geometry", geometry.is_some()),
        ("joint", !joint.is_empty()),
        ("motors", motors.is_some()),
        ("safety", safety.is_some()),
        ("identified", identified.is_some()),
        ("packet", packet.is_some()),
        ("check", !check.is_empty()),
    ];
    for (key, _) in tables.iter().filter(|(_, is_written)| *is_written) {
        checks.not_accepted(key, "left out: a simulated arm (codec \"sim\") has none");
    }
}

fn axes(checks: &mut Checks<'_>, key: &str, written: Option<&[String]>) -> Axes {
    let names = checks.given(key, written, "an array of axes out of x, y, z, rx, ry, rz, grip");
    let mut axes = Axes::NONE;
    for (index, name) in names.into_iter().flatten().enumerate() {
        let key = format!("{key}[{index}]");
        match Axes::from_name(name) {
            Some(axis) if axes.contains(axis) => {
                checks.not_accepted(&key, "an axis that was not named before")
            }
            Some(axis) => axes = axes.union(axis),
            None => {
                let known = Axes::NAMES.map(str::to_owned).to_vec();
                checks.refuse(
                    &key,
                    ProblemKind::UnknownWord { nearest: nearest(name, Axes::NAMES), known },
                );
            }
        }
    }
    axes
}

/// A force or torque limit: zero exactly where none of the axes is actuated.
fn limit(
    checks: &mut Checks<'_>,
    key: &str,
    written: Option<f64>,
    actuated: Axes,
    axes: Axes,
    (most, unit): (f64, &'static str),
) -> f64 {
    let is_actuated =
        axes.names().any(|name| Axes::from_name(name).is_some_and(|axis| actuated.contains(axis)));
    let number = checks.required(key, written, FINITE);
    if number > most {
        checks.not_accepted(key, format_args!("at most {most} {unit}, whatever the arm"));
        return number;
    }
    if is_actuated && number <= 0.0 {
        checks.not_accepted(key, "greater than 0: device.actuated names axes that it limits");
    } else if !is_actuated && number != 0.0 && number.is_finite() {
        checks.not_accepted(key, "0: device.actuated names none of its axes");
    }
    number
}
