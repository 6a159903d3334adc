"""The examples as users start them."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
from conftest import HUNG_S, REPOSITORY, SCENES, lifted

from hapticd import Client, Run

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def example(name: str, *args: str | Path, status: int = 0) -> str:
    line = [sys.executable, EXAMPLES / name, *args]
    ended = subprocess.run(line, capture_output=True, text=True, timeout=HUNG_S, env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"})
    assert ended.returncode == status, ended.stdout + ended.stderr
    return ended.stdout if status == 0 else ended.stderr


def table(out: str) -> np.ndarray | None:
    """Rows of what an example wrote; None where it is a picture."""
    written = Path(re.search(r"wrote (\S+)", out)[1])  # type: ignore[index]
    if written.suffix == ".png":
        assert written.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
        return None
    return np.loadtxt(written, delimiter=",", skiprows=1)


def test_forces_of_a_recording_are_drawn(tmp_path: Path) -> None:
    out = example("plot_forces.py", REPOSITORY / "tests/fixtures/block-on-plane.mcap", "--out", tmp_path / "forces.png")
    assert "block on plane: at most" in out
    rows = table(out)
    assert rows is None or rows.shape[1] == 4 and rows[:, 1].max() > 0
    assert "no-such.mcap" in example("plot_forces.py", tmp_path / "no-such.mcap", status=1)


def test_the_force_meter_shows_the_largest_force(run: Run, arm: Client) -> None:
    lifted(arm)
    out = example("force_meter.py", "--address", run.address, "--seconds", "10")
    assert "enabled" in out and float(re.search(r"at most ([\d.]+) N", out)[1]) > 0  # type: ignore[index]
    assert "127.0.0.1:1" in example("force_meter.py", "--address", "http://127.0.0.1:1", status=1)


def test_a_part_is_moved_and_felt(run: Run, tmp_path: Path) -> None:
    out = example("move_part.py", "--address", run.address, "--object", "lift", "--amplitude-m", "0.012", "--seconds", "3", "--out", tmp_path / "felt.png")
    assert float(re.search(r"in ([\d.]+) s", out)[1]) >= 3  # type: ignore[index]
    rows = table(out)
    if rows is not None:
        assert rows.shape[1] == 5 and np.all(np.isfinite(rows)) and np.all(np.diff(rows[:, 0]) > 0)
        assert np.mean(rows[:, 4]) > 0.5 and np.ptp(rows[:, 3]) > 1, "the tool was lifted while force flowed"
    assert "lift" in example("move_part.py", "--address", run.address, "--object", "nope", status=1)


def test_a_sweep_finds_that_stiffer_is_shallower(tmp_path: Path) -> None:
    out = tmp_path / "sweep.csv"
    example("sweep_parameter.py", SCENES / "block-on-plane.toml", "--values", "1000", "10000", "--seconds", "8", "--out", out)
    rows = np.loadtxt(out, delimiter=",", skiprows=1)
    assert rows[:, 0].tolist() == [1000, 10000]
    soft, stiff = rows
    assert soft[4] > 2 * stiff[4] > 0, "ten times stiffer: far less deep"
    assert np.all(rows[:, 5] > 0.2) and np.all(rows[:, 1] > rows[:, 2]) and np.all(rows[:, 2] > 0)
    wrong = example("sweep_parameter.py", SCENES / "block-on-plane.toml", "--values", "-1", status=1)
    assert "contact_stiffness_n_per_m` goes from" in wrong


def test_clay_is_pulled_and_taken_back() -> None:
    before, pulled, undone, redone = map(float, re.findall(r"([\d.]+) mm", example("pull_and_undo.py")))
    assert pulled > before + 1 and undone == before and redone == pulled
