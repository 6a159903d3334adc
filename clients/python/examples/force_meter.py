#!/usr/bin/env python3
"""A force meter on the terminal: a bar for the force of now, and a mark for the largest of the last seconds.

    hapticd run config/scenes/peg-in-hole.toml --hand-repeat       # one terminal
    python3 force_meter.py                                         # another
"""

from __future__ import annotations

import argparse
import collections
import sys

import numpy as np

from hapticd import Client, HapticdError

WIDTH = 50
HOLD_S = 2.0


def bar(force_n: float, peak_n: float, limit_n: float) -> str:
    """`######····|····`: the force, and where its peak was, of the limit."""
    filled, mark = (min(WIDTH - 1, int(WIDTH * n / limit_n)) for n in (force_n, peak_n))
    return "".join("#" if i < filled else "|" if i == mark else "·" for i in range(WIDTH))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--address", default="http://127.0.0.1:7878", help="what `hapticd run` announces")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="loop time after which it ends [default: with the run]")
    args = parser.parse_args()
    recent: collections.deque[tuple[float, float]] = collections.deque()
    begin_s, largest_n = None, 0.0
    try:
        with Client(args.address) as arm:
            limit_n = arm.get("limit_force_n")
            # History: so that no peak between two states is missed.
            for state in arm.states(rate_hz=20, history=True):
                begin_s = state.time_s if begin_s is None else begin_s
                force_n = float(np.linalg.norm(state.servo_cf.f))
                between = state.history[:, 1] if state.history is not None else np.empty(0)
                recent.append((state.time_s, max(force_n, between.max(initial=0.0))))
                while recent[0][0] < state.time_s - HOLD_S:
                    recent.popleft()
                peak_n = max(force for _, force in recent)
                largest_n = max(largest_n, peak_n)
                why = "" if state.off_cause == "none" else f" ({state.off_cause})"
                print(f"\r{bar(force_n, peak_n, limit_n)} {force_n:6.3f} N  {state.phase}{why}\033[K", end="", flush=True)
                if state.time_s - begin_s >= args.seconds:
                    break
    except HapticdError as problem:
        sys.exit(f"\n{args.address}: {problem}")
    except KeyboardInterrupt:
        pass
    print(f"\nat most {largest_n:.3f} N")


if __name__ == "__main__":
    main()
