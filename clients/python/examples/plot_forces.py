#!/usr/bin/env python3
"""Draws force, torque and depth of a recording over time.

    hapticd run config/scenes/peg-in-hole.toml --clock virtual --duration 10s --record peg.mcap
    python3 plot_forces.py peg.mcap --out peg.png

Needs `hapticd[recordings]`, and matplotlib for the picture; without it the numbers go to a CSV file of the same name.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from hapticd.recordings import Recording, RecordingError, load

COLUMNS = ("force (N)", "torque (N·m)", "depth (mm)")


def rows(recording: Recording) -> np.ndarray:
    """Time (s), command force (N), command torque (N·m), depth (mm) of each tick."""
    force_n = np.linalg.norm(recording.command.force_n, axis=1)
    torque_nm = np.linalg.norm(recording.command.torque_nm, axis=1)
    return np.column_stack([recording.timing.time_s, force_n, torque_nm, recording.contact.max_depth_m * 1e3])


def draw(table: np.ndarray, title: str, out: Path) -> Path:
    """Writes a picture, or a CSV file where matplotlib is not there; returns what was written."""
    try:
        import matplotlib
    except ImportError:
        out = out.with_suffix(".csv")
        np.savetxt(out, table, delimiter=",", header="t_s,force_n,torque_nm,depth_mm", comments="")
        return out
    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(3, sharex=True, figsize=(9, 6), layout="constrained")
    for axis, column, label in zip(axes, table.T[1:], COLUMNS):
        axis.plot(table[:, 0], column, linewidth=0.8)
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
    axes[0].set_title(title)
    axes[-1].set_xlabel("time since the loop began (s)")
    figure.savefig(out, dpi=120)
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("recording", type=Path)
    parser.add_argument("--out", type=Path, default=Path("forces.png"))
    args = parser.parse_args()
    try:
        recording = load(args.recording, ["/wrench/command", "/wrench/contact"])
    except (RecordingError, OSError) as problem:
        sys.exit(str(problem))
    table = rows(recording)
    end = "" if recording.is_whole else ", cut off"
    print(f"{len(recording)} ticks of {recording.scenes[0].name}{end}: at most {table[:, 1].max():.3f} N, {table[:, 3].max():.3f} mm deep")
    print(f"wrote {draw(table, recording.scenes[0].name, args.out)}")


if __name__ == "__main__":
    main()
