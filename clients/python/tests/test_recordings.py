"""Recordings as arrays, beside what the run said of itself."""

from __future__ import annotations

import json
import os
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import HUNG_S, LIFT, REPOSITORY

from hapticd import Client, fault_names
from hapticd.recordings import RecordingError, load

FIXTURES = REPOSITORY / "tests" / "fixtures"


def test_a_recording_says_what_the_run_said(tmp_path: Path) -> None:
    file = tmp_path / "lift.mcap"
    moves = f"lift={REPOSITORY / 'config/scenes/moves/lift.csv'}"
    line: list[str | Path] = [os.environ["HAPTICD"], "run", LIFT, "--clock", "virtual", "--duration", "2s", "--cache", "off", "--json"]
    line += ["--record", file, "--move", moves]
    ended = subprocess.run(line, capture_output=True, text=True, timeout=HUNG_S, check=True)
    said = json.loads(ended.stdout)
    recording = load(file)
    n = said["ticks"]
    assert len(recording) == n and recording.is_whole and recording.dropped == 0 and recording.rate_hz == said["rate_hz"]
    assert np.array_equal(recording.timing.tick, np.arange(n))
    assert np.allclose(np.diff(recording.timing.time_s), 1e-3)
    assert recording.timing.time_s[-1] == pytest.approx(said["duration_s"])
    assert np.linalg.norm(recording.command.force_n, axis=1).max() == said["max_force_n"] > 0
    assert np.linalg.norm(recording.rendered.force_n, axis=1).max() == said["rendered"]["max_force_n"]
    assert np.linalg.norm(recording.command.torque_nm, axis=1).max() == said["max_torque_nm"]
    assert recording.contact.max_depth_m.max() == said["max_depth_m"]
    assert np.count_nonzero(recording.contact.contacts) == said["contact_ticks"] > 0
    end = said["final_pose"]
    assert np.allclose(recording.tool.position_m[-1], [end["x_m"], end["y_m"], end["z_m"]], atol=1e-9)
    assert np.allclose(recording.tool.orientation_xyzw[-1], [end["qx"], end["qy"], end["qz"], end["qw"]], atol=1e-9)
    assert recording.command.drive[-1] == "DISABLED" and "ENABLED" in recording.command.drive and set(recording.device.status) == {"FRESH"}
    assert set(recording.command.off_cause) <= {"none", "software"} and set(recording.device.request) >= {"ENABLE", "STOP"}
    # The lift rises from 1.5 s on, by 4 mm.
    objects = recording.objects
    assert set(objects.object_idx) == {0} and objects.position_m[-1, 2] == pytest.approx(0.004, abs=1e-4)
    assert objects.tick[objects.position_m[:, 2] > 0].min() == pytest.approx(1500, abs=5)
    (scene,) = recording.scenes
    assert scene.name == "lift with block" and scene.toml == LIFT.read_text() and scene.resolved["parameters"]["period_s"] == 1e-3

    some = load(file, ["/wrench/command"])
    assert np.array_equal(some.command.force_n, recording.command.force_n) and some.tool.position_m.shape == (0, 3) and len(some) == n
    with pytest.raises(ValueError, match="no channel is called /tool; known: .*/tool/pose"):
        load(file, ["/tool"])


def test_a_recording_is_shown_in_one_line() -> None:
    recording = load(FIXTURES / "block-on-plane.mcap")
    shown = repr(recording)
    assert "\n" not in shown and len(shown) < 300
    assert shown.startswith("<Recording '") and "block-on-plane.mcap'" in shown and f"{len(recording)} ticks" in shown
    assert f"at {recording.rate_hz:g} Hz" in shown and recording.scenes[0].name in shown and "cut off" not in shown
    assert "\n" not in repr(recording.scenes) and recording.scenes[0].name in repr(recording.scenes)


@pytest.mark.parametrize("name", ["block-on-plane", "lift-with-block"])
def test_shipped_recordings_are_read(name: str) -> None:
    recording = load(FIXTURES / f"{name}.mcap")
    assert recording.is_whole and len(recording) > 100 and np.all(np.isfinite(recording.command.force_n))
    assert recording.faults == () and not np.any(recording.command.faults)
    assert np.allclose(np.linalg.norm(recording.device.orientation_xyzw, axis=1), 1)


def test_a_recording_that_was_cut_is_read_up_to_the_cut(tmp_path: Path) -> None:
    data = (FIXTURES / "block-on-plane.mcap").read_bytes()
    whole = load(FIXTURES / "block-on-plane.mcap")
    file = tmp_path / "cut.mcap"
    read = set()
    for n_bytes in np.random.default_rng(8).integers(0, len(data), 40).tolist():
        for tail in (b"", bytes(4096)):
            file.write_bytes(data[:n_bytes] + tail)
            try:
                cut = load(file)
            except RecordingError as error:
                assert str(file) in str(error)
                continue
            n = len(cut)
            assert not cut.is_whole and cut.dropped is None or n == len(whole)
            assert np.array_equal(cut.timing.time_s, whole.timing.time_s[:n])
            for channel in ("device", "tool", "contact", "command", "rendered"):
                for field in type(getattr(whole, channel)).__slots__:
                    assert np.array_equal(getattr(getattr(cut, channel), field), getattr(getattr(whole, channel), field)[:n]), (channel, field)
            read.add(n)
    assert len(read) > 1, f"cut at several places: {read}"


def test_the_recording_of_a_killed_run_is_read(tmp_path: Path) -> None:
    file = tmp_path / "killed.mcap"
    line: list[str | Path] = [os.environ["HAPTICD"], "run", LIFT, "--clock", "virtual", "--hand-repeat", "--cache", "off", "--json", "--record", file]
    with subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        while not file.exists() or file.stat().st_size < 2_000_000:
            assert process.poll() is None
            time.sleep(0.02)
        process.kill()
    recording = load(file)
    assert not recording.is_whole and recording.dropped is None
    assert np.array_equal(recording.timing.tick, np.arange(len(recording))) and len(recording) > 1000
    assert recording.command.force_n.shape == recording.tool.position_m.shape == (len(recording), 3) and recording.command.force_n.any()


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    for content in (b"", b"not a recording", bytes(1000)):
        file = tmp_path / "wrong.mcap"
        file.write_bytes(content)
        with pytest.raises(RecordingError, match="wrong.mcap: no MCAP file"):
            load(file)
    with pytest.raises(FileNotFoundError):
        load(tmp_path / "missing.mcap")


def test_clients_begin_and_end_recordings(arm: Client, state_home: Path) -> None:
    begun = arm.record("by-a-client")
    arm.capture(0.5)
    ended = arm.end_recording()
    assert Path(ended.file) == Path(begun.file) and Path(ended.file).is_relative_to(state_home)
    recording = load(ended.file)
    assert len(recording) == ended.records > 400 and recording.timing.tick[0] > 0
    assert recording.dropped == ended.dropped
    assert [fault_names(bits) for bits in set(recording.command.faults)] == [()]
