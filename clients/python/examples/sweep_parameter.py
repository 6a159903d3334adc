#!/usr/bin/env python3
"""Sweeps a parameter in simulated time: how hard, how deep and how smooth a scene feels for each of its values.

    python3 sweep_parameter.py config/scenes/block-on-plane.toml --values 1000 2000 5000 10000

The program is started by itself (HAPTICD names it, else `hapticd` of the path). Under the virtual clock it goes as fast as the machine allows; its
simulated hand goes its path there and back all the time. For each value every tick of a stretch is recorded, read and judged.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from pathlib import Path

import numpy as np

from hapticd import Client, HapticdError, Run
from hapticd.recordings import load

SETTLE_S = 0.6
"""Loop time after which a parameter is where it was set: half a second through its whole range."""
HEADER = ("value", "max_force_n", "mean_force_n", "ripple_n", "mean_depth_mm", "contact_share")


def stretch(arm: Client, duration_s: float) -> Path:
    """Records at least so much loop time; the file."""
    set_s = arm.state().time_s
    arm.wait_until(lambda state: state.time_s > set_s + SETTLE_S)
    arm.record()
    # States arrive some time after their tick, and loop time may run a hundred times as fast as ours: only the recording knows how long it is.
    n_ticks = round(duration_s * arm.info()["rate_hz"])
    while (recording := arm.info()["recording"]) and recording["records"] < n_ticks:
        time.sleep(0.01)
    return Path(arm.end_recording().file)


def judged(file: Path, duration_s: float) -> tuple[float, ...]:
    """Largest and mean force in contact (N), what of it changes within 10 ms (rms, N), mean of the largest depth (mm), share of ticks in contact.

    The largest depth of all would be that of the landing: how far the hand comes in a tick, or an encoder tells, whatever the parameter is.
    """
    recording = load(file, ["/wrench/command", "/wrench/contact"])
    n_ticks = round(duration_s * recording.rate_hz)
    if len(recording) < n_ticks or recording.dropped:
        raise HapticdError(f"{file}: {len(recording)} ticks, {recording.dropped} dropped; {n_ticks} are needed")
    force_n = recording.command.force_n[:n_ticks]
    touches = recording.contact.contacts[:n_ticks] > 0
    n_smooth = max(1, round(0.01 * recording.rate_hz))
    smooth_n = np.column_stack([np.convolve(axis, np.full(n_smooth, 1 / n_smooth), mode="same") for axis in force_n.T])
    size_n, ripple_n = np.linalg.norm(force_n, axis=1)[touches], np.linalg.norm(force_n - smooth_n, axis=1)[touches]
    if not touches.any():
        return 0.0, 0.0, 0.0, 0.0, 0.0
    depth_mm = recording.contact.max_depth_m[:n_ticks][touches].mean() * 1e3
    return size_n.max(), size_n.mean(), np.sqrt((ripple_n**2).mean()), depth_mm, touches.mean()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scene", type=Path)
    parser.add_argument("--parameter", default="contact_stiffness_n_per_m", help="as in GET /api/v1/parameters")
    parser.add_argument("--values", type=float, nargs="+", metavar="X", help="SI [default: five through its range]")
    parser.add_argument("--seconds", type=float, default=10.0, help="loop time for each value: best the hand's way there and back")
    parser.add_argument("--out", type=Path, help="a CSV file of the same")
    args = parser.parse_args()
    rows = []
    try:
        with Run(args.scene, "--hand-repeat", clock="virtual") as run, run.connect() as arm:
            known = arm.parameters()
            if args.parameter not in known:
                sys.exit(f"no parameter is called {args.parameter}; known: {', '.join(known)}")
            parameter = known[args.parameter]
            least = max(parameter.least, parameter.most * 1e-2)
            print("  ".join(f"{name:>13}" for name in HEADER))
            for value in args.values or np.geomspace(least, parameter.most, 5):
                arm.set(args.parameter, value)
                file = stretch(arm, args.seconds)
                rows.append((value, *judged(file, args.seconds)))
                file.unlink()
                print("  ".join(f"{number:13.6g}" for number in rows[-1]), flush=True)
    except HapticdError as problem:
        sys.exit(str(problem))
    if args.out:
        with open(args.out, "w", newline="") as out:
            csv.writer(out).writerows([HEADER, *rows])


if __name__ == "__main__":
    main()
