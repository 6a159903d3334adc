#!/usr/bin/env python3
"""Judges what tests/hil-vm/links.sh left behind.

  judge.py --list              names of the checks
  judge.py OUTDIR [NAME...]    one line for each check; exits with 1 if any failed

OUTDIR is that of scripts/hil-vm, with reference.json beside: the summary of the same scene with the arm in the process,
`hapticd run config/scenes/block-on-plane.toml --device sim-sigma7 --clock virtual --duration 8s --json`.
"""

import json
import math
import sys
from pathlib import Path

# A hand of 500 N/m is held back by 0.05 N of friction and one step of the encoder, on either side.
SAME_END_M = 0.3e-3
# A hand that wants to be 1.5 mm deep feels more than this.
PUSHED_N = 0.1
# The most that an arm does whose signs are unchecked.
UNVERIFIED_N = 0.5
# Where the tool begins.
START_M = [0.0, 0.0, 15e-3]


class Run:
    """Both summaries of one exchange."""

    def __init__(self, folder, name):
        self.arm = json.loads((folder / f"{name}.arm.json").read_text())
        self.said = (folder / f"{name}.host.err").read_text()
        self.code = int((folder / f"{name}.host.code").read_text())
        text = (folder / f"{name}.host.json").read_text()
        self.host = json.loads(text) if text else None

    def __str__(self):
        return f"exit {self.code}\nhost: {json.dumps(self.host)}\narm: {json.dumps(self.arm)}\n{self.said}"

    @property
    def faults(self):
        return self.host["faults"]

    def end(self):
        return [self.host["final_pose"][key] for key in ("x_m", "y_m", "z_m")]

    def arm_feels_nothing(self):
        return all(value == 0.0 for value in self.arm["last_command"].values())


def same_end(run, folder):
    reference = json.loads((folder / "reference.json").read_text())["final_pose"]
    pressed(run, folder)
    apart_m = math.dist(run.end(), [reference[key] for key in ("x_m", "y_m", "z_m")])
    assert apart_m < SAME_END_M, f"{apart_m * 1e3:.3f} mm from the end in the process"


def pressed(run, _):
    """Found, pressed, no fault, nothing left at the end."""
    assert (run.code, run.faults) == (0, []), "no fault"
    assert run.host["contact_ticks"] > 0, "it touched"
    assert run.arm["largest_force_n"] > PUSHED_N, "it was felt"
    assert run.arm_feels_nothing(), "nothing pushes afterwards"


def unverified(run, folder):
    """Pressed, with what an arm may do whose signs are unchecked."""
    pressed(run, folder)
    assert run.arm["largest_force_n"] <= UNVERIFIED_N, "no more than that"


def steered(run, _):
    assert (run.code, run.faults) == (0, []), "no fault"
    assert run.arm["largest_force_n"] == 0.0 and run.host["max_force_n"] >= 0.0, "no motors"
    assert math.dist(run.end(), START_M) > 3e-3, "the tool moved"


def refused(what):
    def check(run, _):
        assert run.code == 5 and run.host is None, "the arm is refused"
        assert what in run.said, f"it says why: {what}"
        assert run.arm["largest_force_n"] == 0.0, "nothing pushed"

    return check


def stopped(fault):
    """Pushed before, this fault, and the motors let go for good."""

    def check(run, _):
        assert (run.code, run.faults) == (7, [fault]), fault
        felt = run.arm["faults"][0]
        assert felt["force_before_n"] > PUSHED_N, "it pushed before"
        assert felt["zero_after_ticks"] is not None, "the motors stopped"
        assert felt["force_again_after_ticks"] is None, "no force comes back"
        assert run.arm_feels_nothing(), "nothing pushes afterwards"

    return check


def recovered(run, _):
    assert (run.code, run.faults) == (7, ["disconnected"]), "disconnected, and reported at the end"
    assert run.said.count("state: enabled") == 2 and "device: back" in run.said, "enabled again"
    felt = run.arm["faults"][0]
    assert felt["force_before_n"] > PUSHED_N, "it pushed before"
    assert felt["zero_after_ticks"] is not None, "the motors stopped"
    assert run.arm_feels_nothing(), "nothing pushes afterwards"


def guarded(run, _):
    """Killed while it pushed: the guard's zero came before the arm's own watchdog."""
    assert run.code == 137 and run.host is None, "killed"
    assert run.arm["largest_force_n"] > PUSHED_N, "it pushed before"
    assert run.arm_feels_nothing(), "nothing pushes afterwards"
    assert run.arm["watchdog_trips"] == 0, "not by its own watchdog"


def unplugged(run, _):
    assert (run.code, run.faults) == (7, ["disconnected"]), "disconnected"
    assert run.arm["largest_force_n"] > PUSHED_N, "it pushed before"
    assert run.arm_feels_nothing(), "its own watchdog let go"


CHECKS = {
    "hidraw": same_end,
    "woodenhaptics": unverified,
    "polhem-mbed": unverified,
    "polhem-rawhid": unverified,
    "not-woodenhaptics": refused("another profile"),
    "not-polhem": refused("woodenhaptics-hid8"),
    "spacemouse": steered,
    "nan": stopped("non-finite"),
    "garbage": stopped("protocol"),
    "stall": stopped("stale"),
    "unplug": stopped("disconnected"),
    "replug": recovered,
    "killed-open6": guarded,
    "killed-woodenhaptics": guarded,
    "killed-polhem-mbed": guarded,
    "killed-polhem-rawhid": guarded,
    "acm": same_end,
    "usb-hid": same_end,
    "usb-unplug": unplugged,
}


def main():
    if sys.argv[1:] == ["--list"]:
        print("\n".join(CHECKS))
        return 0
    if len(sys.argv) < 2:
        print(__doc__, file=sys.stderr)
        return 2
    folder, names = Path(sys.argv[1]), sys.argv[2:] or list(CHECKS)
    failed = 0
    for name in names:
        run = None
        try:
            run = Run(folder, name)
            CHECKS[name](run, folder)
        except (AssertionError, KeyError, IndexError, TypeError, OSError, ValueError) as error:
            failed += 1
            print(f"FAILED  {name}: {type(error).__name__}: {error}\n{run or ''}")
        else:
            print(f"ok      {name}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
