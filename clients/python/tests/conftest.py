"""Real runs for the tests. `HAPTICD` names the program; ports are free ones, files go to a folder of the test."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

import pytest

from hapticd import Client, Run

REPOSITORY = Path(__file__).resolve().parents[3]
SCENES = REPOSITORY / "config" / "scenes"
LIFT = SCENES / "lift-with-block.toml"
BALL = Path(__file__).resolve().parents[1] / "examples" / "ball.toml"
OPTIONS = ("--cache", "off", "--realtime", "best-effort", "--hand-repeat")
LIFTED_M = 0.008
HUNG_S = 120


@pytest.fixture(autouse=True)
def hung() -> Iterator[None]:
    """Ends a test that hangs: nothing else in it would."""

    def say(_signal: int, _frame: FrameType | None) -> None:
        raise TimeoutError(f"the test hangs: it took more than {HUNG_S} s")

    before = signal.signal(signal.SIGALRM, say)
    signal.alarm(HUNG_S)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.fixture(scope="session", autouse=True)
def state_home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where runs put what clients record and save."""
    folder = tmp_path_factory.mktemp("state")
    os.environ["XDG_STATE_HOME"] = str(folder)
    os.environ.pop("HAPTICD_TOKEN", None)
    assert "HAPTICD" in os.environ, "HAPTICD has to name the program"
    return folder


@pytest.fixture(scope="session")
def run(state_home: Path) -> Iterator[Run]:
    """A run on the real clock whose hand presses a block onto a part that can be moved, again and again."""
    with Run(LIFT, *OPTIONS) as run:
        yield run
        status = run.stop()
        # A machine that stood still for 50 ms takes force away, rightly; time decides no test.
        faults = (run.result or {}).get("faults")
        assert status == 0 or (status == 7 and faults == ["overrun"]), run.talk


@pytest.fixture
def arm(run: Run) -> Iterator[Client]:
    """A client of that run, with force and the part where it was at first: a tool that starts inside of it gets none."""
    with run.connect() as arm:
        arm.place("lift", [0, 0, 0])
        arm.wait_until(lambda state: abs(state.objects[0].p[2]) < 1e-6)
        arm.enable()
        arm.wait_until(lambda state: state.phase == "enabled")
        yield arm


def lifted(arm: Client) -> None:
    """Lifts the part until the tool has to touch it, wherever the hand was when force came in."""
    arm.place("lift", [0, 0, LIFTED_M])
    arm.wait_until(lambda state: abs(state.objects[0].p[2] - LIFTED_M) < 1e-6)
