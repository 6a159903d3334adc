#!/usr/bin/env python3
"""Moves a part up and down under the tool, captures every tick meanwhile, and says what the hand felt.

    hapticd run config/scenes/lift-with-block.toml           # in one terminal
    python3 move_part.py --object lift                       # in another

Needs matplotlib for the picture; without it the numbers go to a CSV file of the same name.
"""

from __future__ import annotations

import argparse
import sys
import threading
import time
from pathlib import Path

import numpy as np

from hapticd import Client, HapticdError, state_names


def steer(arm: Client, args: argparse.Namespace, is_over: threading.Event, problems: list[HapticdError]) -> None:
    """Lets the object follow a sine in height, 60 poses a second. A pose is a wish: the server bounds how fast it is followed."""
    begin_s = time.monotonic()
    while not is_over.wait(1 / 60):
        phase = 2 * np.pi * (time.monotonic() - begin_s) / args.period_s
        try:
            arm.place(args.object, np.array(args.base) + [0.0, 0.0, args.amplitude_m * 0.5 * (1 - np.cos(phase))])
        except HapticdError as problem:
            problems.append(problem)
            return


def felt(args: argparse.Namespace) -> np.ndarray:
    """Rows of time (s), force of the command (N), depth (mm), height of the tool (mm), force on or off."""
    is_over = threading.Event()
    problems: list[HapticdError] = []
    with Client(args.address, token=args.token, heartbeat_ms=1000) as arm:
        arm.place(args.object, args.base)
        arm.enable()
        steering = threading.Thread(target=steer, args=(arm, args, is_over, problems))
        steering.start()
        try:
            states = arm.capture(args.seconds)
        finally:
            is_over.set()
            steering.join()
            if not problems:
                arm.place(args.object, args.base)
    if problems:
        raise problems[0]
    force_n = np.linalg.norm(states["servo_cf"]["f"], axis=1)
    height_mm = states["tool_cp"]["p"][:, 2] * 1e3
    return np.column_stack([states["time_ns"] * 1e-9, force_n, states["max_depth_m"] * 1e3, height_mm, state_names(states) == "ENABLED"])


def draw(rows: np.ndarray, out: Path) -> Path:
    """Writes a picture, or a CSV file where matplotlib is not there; returns what was written."""
    try:
        import matplotlib
    except ImportError:
        out = out.with_suffix(".csv")
        np.savetxt(out, rows, delimiter=",", header="t_s,force_n,depth_mm,tool_z_mm,enabled", comments="")
        return out
    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(3, sharex=True, figsize=(8, 6), layout="constrained")
    for axis, column, label in zip(axes, rows.T[1:], ("force (N)", "depth (mm)", "tool height (mm)")):
        axis.plot(rows[:, 0] - rows[0, 0], column, linewidth=1)
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
    axes[-1].set_xlabel("time (s)")
    figure.savefig(out, dpi=120)
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--address", default="http://127.0.0.1:7878", help="what `hapticd run` announces")
    parser.add_argument("--token", help="where the server asks for one")
    parser.add_argument("--object", required=True, help="name of a movable part")
    parser.add_argument("--base", type=float, nargs=3, default=(0.0, 0.0, 0.0), metavar=("X", "Y", "Z"), help="where the motion begins, m")
    parser.add_argument("--amplitude-m", type=float, default=0.006)
    parser.add_argument("--period-s", type=float, default=2.0)
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--out", type=Path, default=Path("felt.png"))
    args = parser.parse_args()
    try:
        rows = felt(args)
    except (HapticdError, ValueError) as problem:
        sys.exit(f"{args.address}: {problem}")
    force_n = rows[:, 1]
    print(f"{len(rows)} states in {np.ptp(rows[:, 0]):.2f} s of loop time, {100 * rows[:, 4].mean():.0f} % enabled")
    print(f"force {force_n.mean():.3f} N on average, at most {force_n.max():.3f} N; depth at most {rows[:, 2].max():.3f} mm")
    print(f"wrote {draw(rows, args.out)}")


if __name__ == "__main__":
    main()
