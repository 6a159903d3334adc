#!/usr/bin/env python3
"""Moves a part up and down under the tool, reads the state meanwhile, and draws what the hand felt.

    hapticd run config/scenes/lift-with-block.toml           # in one terminal
    python3 examples/python/move_and_plot.py --object lift   # in another

Needs `pip install websockets numpy`, and matplotlib for the picture (`--out felt.png`); without it the numbers go to a CSV file.
"""

import argparse
import asyncio
import pathlib
import sys
import time

import numpy as np

from hapticd_client import Client, Refused


async def steer(arm, obj, base, amplitude_m, period_s):
    """Lets the object follow a sine in height, 60 poses a second. A pose is a wish: the server bounds how fast it is followed."""
    begin = time.monotonic()
    while True:
        phase = 2 * np.pi * (time.monotonic() - begin) / period_s
        up = amplitude_m * 0.5 * (1 - np.cos(phase))
        await arm.place(obj, base + np.array([0.0, 0.0, up]))
        await asyncio.sleep(1 / 60)


async def record(arm, seconds, rate_hz):
    """Rows of time (s), force of the command (N), depth (mm), height of the tool (mm), rendered by the arm or not."""
    rows = []
    async for state in arm.states(rate_hz):
        force = np.linalg.norm(state["servo_cf"]["f"])
        rows.append([state["time_ns"] * 1e-9, force, state["max_depth_m"] * 1e3, state["tool_cp"]["p"][2] * 1e3, state["state"] == "ENABLED"])
        if rows[-1][0] - rows[0][0] >= seconds:
            break
    return np.array(rows, dtype=float)


def draw(rows, path):
    """Writes a PNG where matplotlib is there, else a CSV file beside it; returns what was written."""
    try:
        import matplotlib
    except ImportError:
        path = path.with_suffix(".csv")
        np.savetxt(path, rows, delimiter=",", header="t_s,force_n,depth_mm,tool_z_mm,enabled", comments="")
        return path
    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(3, sharex=True, figsize=(8, 6), layout="constrained")
    for axis, column, label in zip(axes, (1, 2, 3), ("force, N", "depth, mm", "tool height, mm")):
        axis.plot(rows[:, 0] - rows[0, 0], rows[:, column], linewidth=1)
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
    axes[-1].set_xlabel("time, s")
    figure.savefig(path, dpi=120)
    return path


async def felt(args):
    """Steers and records until the time is over, or one of both fails: a part that does not move is no result."""
    async with Client(args.url, token=args.token, heartbeat_ms=1000) as arm:
        await arm.ask("enable")
        steering = asyncio.create_task(steer(arm, args.object, np.array(args.base), args.amplitude_m, args.period_s))
        recording = asyncio.create_task(record(arm, args.seconds, args.rate_hz))
        done, rest = await asyncio.wait({steering, recording}, return_when=asyncio.FIRST_COMPLETED)
        for task in rest:
            task.cancel()
        for task in done:
            rows = task.result()
        return rows


def main(args):
    try:
        rows = asyncio.run(felt(args))
    except (Refused, OSError) as problem:
        sys.exit(f"{args.url}: {problem}")
    # The heartbeat has ended by now: drawing takes longer than it may be silent.
    force = rows[:, 1]
    print(f"{len(rows)} states in {np.ptp(rows[:, 0]):.2f} s of loop time, {100 * rows[:, 4].mean():.0f} % enabled")
    print(f"force {force.mean():.3f} N on average, at most {force.max():.3f} N; depth at most {rows[:, 2].max():.3f} mm")
    print(f"wrote {draw(rows, args.out)}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--url", default="http://127.0.0.1:7878", help="address of the monitor page")
    parser.add_argument("--token", help="where the server asks for one")
    parser.add_argument("--object", required=True, help="name of a movable part")
    parser.add_argument("--base", type=float, nargs=3, default=(0.0, 0.0, 0.0), metavar=("X", "Y", "Z"), help="where the motion begins, m")
    parser.add_argument("--amplitude-m", type=float, default=0.006)
    parser.add_argument("--period-s", type=float, default=2.0)
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--rate-hz", type=float, default=200.0)
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("felt.png"))
    main(parser.parse_args())
