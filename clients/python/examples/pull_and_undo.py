#!/usr/bin/env python3
"""Pulls a nose out of a ball of clay, takes it back, and pulls it out again.

    python3 pull_and_undo.py                      # starts `hapticd sculpt ball.toml` by itself
    python3 pull_and_undo.py --save nose          # and keeps the mesh

The simulated hand of `ball.csv` touches the top of the ball and draws back; the script holds the clay meanwhile, as if a button of the arm were held.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from hapticd import Client, HapticdError, Run

SCENE = Path(__file__).with_name("ball.toml")
TOUCHES_M, AWAY_M = 0.0195, 0.0235


def height_mm(arm: Client) -> float:
    """How high the clay reaches, in its own frame."""
    points = arm.clay.points()
    return 0.0 if points is None else float(points.positions_m[:, 2].max() * 1e3)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--save", metavar="NAME", help="name of a closed mesh (PLY) of the result")
    args = parser.parse_args()
    try:
        with Run(SCENE, "--hand-repeat", command="sculpt") as run, run.connect() as arm:
            arm.wait_until(lambda state: state.phase == "enabled")
            print(f"a ball of {arm.clay.facts().samples} samples, {height_mm(arm):.2f} mm high")
            arm.clay.take("pull", brush_m=0.006)
            arm.wait_until(lambda state: state.tool_cp.p[2] < TOUCHES_M)
            with arm.clay.hold():
                arm.wait_until(lambda state: state.tool_cp.p[2] > AWAY_M)
            arm.clay.wait_until(lambda facts: facts.undo == 1 and not facts.is_stroke)
            print(f"pulled: {height_mm(arm):.2f} mm")
            arm.clay.undo()
            arm.clay.wait_until(lambda facts: facts.redo == 1)
            print(f"undone: {height_mm(arm):.2f} mm")
            arm.clay.redo()
            arm.clay.wait_until(lambda facts: facts.redo == 0)
            print(f"redone: {height_mm(arm):.2f} mm")
            if args.save:
                print(f"wrote {arm.clay.save('export', args.save)}")
    except HapticdError as problem:
        sys.exit(str(problem))


if __name__ == "__main__":
    main()
