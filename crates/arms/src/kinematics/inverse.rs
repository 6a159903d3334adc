//! Joint angles of a pose: in closed form where the arm has one, by damped least squares
//! (Levenberg–Marquardt) on `solve` elsewhere.
//!
//! Cold: start-up, and simulated arms.

use glam::DVec3;

use super::{Configuration, Gimbal, Kinematics};
use crate::axes::MAX_AXES;
use vps::spatial::{Axes, Pose};

/// Position counts as reached, m.
const TOLERANCE_M: f64 = 1e-11;
/// Weight of a radian beside a metre: the reach of a hand-held arm.
pub(crate) const M_PER_RAD: f64 = 0.1;
const STEPS_MAX: usize = 200;

pub(super) fn joints(
    kinematics: &Kinematics,
    target: &Pose,
    near: &[f64; MAX_AXES],
) -> Option<[f64; MAX_AXES]> {
    let position = target.translation;
    match kinematics {
        Kinematics::Cartesian => {
            let ([x, y, z], [qx, qy, qz, qw]) = (position.to_array(), target.rotation.to_array());
            Some([x, y, z, qx, qy, qz, qw, 0.0])
        }
        Kinematics::Rate(_) => None,
        Kinematics::OneAxis(arm) => {
            let mut joints = [0.0; MAX_AXES];
            joints[0] = position.x / arm.m_per_rad;
            Some(joints).filter(|joints| joints[0].is_finite())
        }
        Kinematics::Delta(arm) => {
            let [a, b, c] = arm.angles(position)?;
            let joints = [a, b, c, 0.0, 0.0, 0.0, 0.0, 0.0];
            // Near a singularity the angles exist, but the arm cannot be driven there.
            kinematics
                .solve(
                    &joints,
                    &Configuration { native_from_grip: *target, ..Configuration::default() },
                )
                .map(|_| joints)
        }
        Kinematics::Capstan(arm) => {
            let [a, b, c] = arm.angles(position)?;
            let joints = [a, b, c, 0.0, 0.0, 0.0, 0.0, 0.0];
            Some(with_wrist(
                joints,
                arm.gimbal,
                arm.native_from_link(&joints).conjugate() * target.rotation,
                near,
            ))
        }
        Kinematics::FiveLink(arm) => {
            let joints = search(kinematics, 3, Axes::TRANSLATION, target, near)?;
            let native_from_link = arm.native_from_link(&joints)?;
            Some(with_wrist(
                joints,
                arm.gimbal,
                native_from_link.conjugate() * target.rotation,
                near,
            ))
        }
        Kinematics::Pantograph(_) | Kinematics::Chain(_) => {
            search(kinematics, kinematics.n_joints(), kinematics.axes(), target, near)
        }
    }
}

fn with_wrist(
    mut joints: [f64; MAX_AXES],
    gimbal: Option<Gimbal>,
    link_from_grip: glam::DQuat,
    near: &[f64; MAX_AXES],
) -> [f64; MAX_AXES] {
    if let Some(gimbal) = gimbal {
        [joints[3], joints[4], joints[5]] =
            gimbal.angles(link_from_grip, [near[3], near[4], near[5]]);
    }
    joints
}

pub(super) fn home(kinematics: &Kinematics) -> [f64; MAX_AXES] {
    let start = start(kinematics);
    let centre = match kinematics {
        // A chain has its own idea of its middle, and a pose has no joints to find.
        Kinematics::Chain(_) | Kinematics::Rate(_) => return start,
        _ => Pose::IDENTITY,
    };
    joints(kinematics, &centre, &start).unwrap_or(start)
}

/// Angles on the branch that arms of this kind are built on.
fn start(kinematics: &Kinematics) -> [f64; MAX_AXES] {
    let three = |a, b, c| [a, b, c, 0.0, 0.0, 0.0, 0.0, 0.0];
    match kinematics {
        Kinematics::Chain(chain) => chain.home(),
        // Crank 2 forward and up, crank 3 backward and up.
        Kinematics::FiveLink(_) => three(0.0, 0.9, 2.4),
        // Arms apart by a right angle.
        Kinematics::Pantograph(_) => three(2.4, 0.7, 0.0),
        Kinematics::Delta(_) => three(0.6, 0.6, 0.6),
        Kinematics::Capstan(_) => three(0.0, 0.4, 1.2),
        Kinematics::Cartesian => [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
        Kinematics::OneAxis(_) | Kinematics::Rate(_) => [0.0; MAX_AXES],
    }
}

/// Tries the angles before, then the usual ones, then some around those.
fn search(
    kinematics: &Kinematics,
    n: usize,
    axes: Axes,
    target: &Pose,
    near: &[f64; MAX_AXES],
) -> Option<[f64; MAX_AXES]> {
    let usual = start(kinematics);
    descend(kinematics, n, axes, target, *near)
        .or_else(|| descend(kinematics, n, axes, target, usual))
        .or_else(|| {
            (1..8).find_map(|round| descend(kinematics, n, axes, target, around(&usual, n, round)))
        })
}

/// The first `n` angles, each moved by at most 1 rad (1 m).
pub(super) fn around(angles: &[f64; MAX_AXES], n: usize, round: u32) -> [f64; MAX_AXES] {
    let mut moved = *angles;
    for (idx, angle) in moved.iter_mut().take(n).enumerate() {
        // Golden-ratio steps: an even spread without a random number.
        let spread = (f64::from(round) * 0.618_033_988_75 + idx as f64 * 0.754_877_666_25).fract();
        *angle += 2.0 * (spread - 0.5);
    }
    moved
}

fn descend(
    kinematics: &Kinematics,
    n: usize,
    axes: Axes,
    target: &Pose,
    start: [f64; MAX_AXES],
) -> Option<[f64; MAX_AXES]> {
    let mut angles = start;
    let mut here = kinematics.solve(&angles, &Configuration::default())?;
    let mut miss = residual(&here, target, axes);
    let mut damping = 1e-6;
    for _ in 0..STEPS_MAX {
        if miss.iter().all(|part| part.abs() < TOLERANCE_M) {
            return Some(angles);
        }
        let step = step(&here, &miss, axes, n, damping)?;
        let mut tried = angles;
        for (angle, step) in tried.iter_mut().zip(step).take(n) {
            *angle += step.clamp(-0.5, 0.5);
        }
        let better = kinematics
            .solve(&tried, &here)
            .map(|there| (there, residual(&there, target, axes)))
            .filter(|(_, tried)| norm_squared(tried) < norm_squared(&miss));
        match better {
            Some((there, there_miss)) => {
                (angles, here, miss) = (tried, there, there_miss);
                damping = (damping * 0.1).max(1e-15);
            }
            None => damping *= 10.0,
        }
        if damping > 1e6 {
            return None;
        }
    }
    None
}

fn norm_squared(miss: &[f64; 6]) -> f64 {
    miss.iter().map(|part| part * part).sum()
}

/// What is missing to the target, m; angles weighted to m; axes that the arm does not determine are
/// 0.
fn residual(here: &Configuration, target: &Pose, axes: Axes) -> [f64; 6] {
    let linear = target.translation - here.native_from_grip.translation;
    let mut turn = target.rotation * here.native_from_grip.rotation.conjugate();
    if turn.w < 0.0 {
        turn = -turn;
    }
    masked(linear, 2.0 * turn.xyz(), axes)
}

fn masked(linear: DVec3, angular: DVec3, axes: Axes) -> [f64; 6] {
    let ([x, y, z], [rx, ry, rz]) = (linear.to_array(), (M_PER_RAD * angular).to_array());
    let mut parts = [x, y, z, rx, ry, rz];
    for (idx, part) in parts.iter_mut().enumerate() {
        if !axes.has(idx) {
            *part = 0.0;
        }
    }
    parts
}

/// Solves (JᵀJ + μI)·step = Jᵀ·miss for the first `n` joints.
fn step(
    here: &Configuration,
    miss: &[f64; 6],
    axes: Axes,
    n: usize,
    damping: f64,
) -> Option<[f64; MAX_AXES]> {
    let columns = here.columns.map(|column| masked(column.linear, column.angular, axes));
    let dot = |a: &[f64; 6], b: &[f64; 6]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut rows = [[0.0; MAX_AXES + 1]; MAX_AXES];
    for i in 0..n {
        for j in 0..n {
            rows[i][j] = dot(&columns[i], &columns[j]);
        }
        rows[i][i] += damping;
        rows[i][MAX_AXES] = dot(&columns[i], miss);
    }
    // Symmetric and positive definite: elimination needs no pivoting.
    for i in 0..n {
        let pivot = rows[i];
        if pivot[i].is_nan() || pivot[i] <= 0.0 {
            return None;
        }
        for row in rows.iter_mut().take(n).skip(i + 1) {
            let factor = row[i] / pivot[i];
            for (entry, above) in row.iter_mut().zip(pivot) {
                *entry -= factor * above;
            }
        }
    }
    let mut step = [0.0; MAX_AXES];
    for i in (0..n).rev() {
        let known: f64 = (i + 1..n).map(|j| rows[i][j] * step[j]).sum();
        step[i] = (rows[i][MAX_AXES] - known) / rows[i][i];
    }
    Some(step)
}
