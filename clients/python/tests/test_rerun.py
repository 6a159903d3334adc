"""Recordings for the Rerun viewer: what the file holds is what the recording holds."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from conftest import BALL, HUNG_S, LIFT, OPTIONS, REPOSITORY, SCENES

from hapticd import Run, recordings
from hapticd.recordings import Recording, RecordingError

pytest.importorskip("rerun", reason="rerun-sdk is not installed: HAPTICD_RERUN=1 scripts/client-test installs it")

import rerun as rr
from rerun.chunk import RrdReader

from hapticd import rerun as hapticd_rerun
from hapticd.rerun import Converted, convert

PEG = SCENES / "peg-in-hole.toml"


def recorded(command: str, scene: Path, file: Path, *options: str) -> Path:
    line: list[str | Path] = [os.environ["HAPTICD"], command, scene, "--clock", "virtual", "--cache", "off", "--json", "--record", file]
    subprocess.run([*line, *options], stdout=subprocess.DEVNULL, timeout=HUNG_S, check=True)
    return file


@pytest.fixture(scope="module")
def peg(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded("run", PEG, tmp_path_factory.mktemp("peg") / "peg.mcap", "--duration", "3s")


class Rrd:
    """A file of Rerun, read back with Rerun's own reader."""

    def __init__(self, path: Path) -> None:
        reader = RrdReader(path)
        (self.entry,) = reader.recordings()
        (blueprint,) = reader.blueprints()
        self.chunks = list(reader.stream().to_chunks())
        self.blueprint = list(reader.stream(store=blueprint).to_chunks())
        self.paths = {chunk.entity_path for chunk in self.chunks}

    def _found(self, path: str, name: str) -> list[tuple[np.ndarray, Any]]:
        """Ticks and values of a column in each chunk that has it."""
        batches = [(chunk, chunk.to_record_batch()) for chunk in self.chunks if chunk.entity_path == path]
        found = [(chunk, batch) for chunk, batch in batches if name in batch.schema.names]
        assert found, (path, name)
        return [
            (np.full(chunk.num_rows, -1) if chunk.is_static else batch.column("tick").to_numpy(), batch.column(name)) for chunk, batch in found
        ]

    def column(self, path: str, name: str) -> list[Any]:
        """A column of an entity, ordered by tick; times as whole numbers."""
        rows: list[tuple[int, Any]] = []
        for ticks, values in self._found(path, name):
            rows += zip(ticks.tolist(), values.to_pylist() if ":" in name else values.cast("int64").to_pylist())
        return [value for _, value in sorted(rows, key=lambda row: row[0])]

    def array(self, path: str, name: str) -> np.ndarray:
        """Numbers of a column of an entity, ordered by tick, a row for each."""
        ticks, rows = [], []
        for of_chunk, values in self._found(path, name):
            ticks.append(of_chunk)
            while "list" in str(values.type):
                values = values.flatten()
            rows.append(values.to_numpy().reshape(len(of_chunk), -1))
        return np.vstack(rows)[np.argsort(np.concatenate(ticks), kind="stable")]

    def shown(self) -> str:
        """Everything that the blueprint says, as one text."""
        texts: list[str] = []
        for chunk in self.blueprint:
            batch = chunk.to_record_batch()
            texts += [str(batch.column(name).to_pylist()) for name in batch.schema.names if ":" in name]
        return " ".join(texts)


def same_as(rrd: Rrd, recording: Recording) -> None:
    """Every tick has the values of the recording."""
    n = len(recording)
    contact, command, rendered, device, timing = recording.contact, recording.command, recording.rendered, recording.device, recording.timing
    curves = {
        "/wrench/contact/force_n": contact.force_n,
        "/wrench/contact/torque_nm": contact.torque_nm,
        "/wrench/contact/max_depth_mm": contact.max_depth_m * 1e3,
        "/wrench/contact/clearance_mm": contact.clearance_m * 1e3,
        "/wrench/contact/contacts": contact.contacts,
        "/wrench/command/force_n": command.force_n,
        "/wrench/command/torque_nm": command.torque_nm,
        "/wrench/rendered/force_n": rendered.force_n,
        "/wrench/rendered/torque_nm": rendered.torque_nm,
        "/device/position_mm": device.position_m * 1e3,
        "/loop/timing_us": np.column_stack([timing.compute_s, timing.device_s, timing.wakeup_s]) * 1e6,
    }
    for path, values in curves.items():
        assert np.array_equal(rrd.array(path, "Scalars:scalars"), np.reshape(values, (n, -1)), equal_nan=True), path
        assert rrd.column(path, "tick") == timing.tick.tolist()
        assert rrd.column(path, "time") == np.rint(timing.time_s * 1e9).astype(int).tolist()
    # Rerun keeps what is in space in single precision.
    for path, poses in (("/world/tool", recording.tool), ("/device/grip", device)):
        assert np.array_equal(rrd.array(path, "Transform3D:translation"), poses.position_m.astype(np.float32)), path
        assert np.array_equal(rrd.array(path, "Transform3D:quaternion"), poses.orientation_xyzw.astype(np.float32)), path


@pytest.mark.parametrize("newtons_per_metre", [100.0, 25.0])
def test_the_peg_is_there_with_parts_arrows_curves_and_views(peg: Path, tmp_path: Path, newtons_per_metre: float) -> None:
    out = tmp_path / "peg.rrd"
    converted = convert(peg, out, newtons_per_metre=newtons_per_metre)
    recording = recordings.load(peg)
    assert converted == Converted(out, len(recording), newtons_per_metre, ()) and recording.contact.contacts.any()
    rrd = Rrd(out)
    assert rrd.entry.application_id == "hapticd" and "wall_clock" not in rrd.chunks[0].timeline_names
    same_as(rrd, recording)

    # The meshes are the files of the scene, in metres.
    for path, mesh in (("/world/parts/0/block/shape", "block-hole.obj"), ("/world/tool/0/shape", "peg.obj")):
        assert bytes(rrd.column(path, "Asset3D:blob")[0][0]) == (REPOSITORY / "config/models" / mesh).read_bytes()
        assert np.allclose(rrd.array(path, "Transform3D:scale"), 1e-3)
    # Arrows: to the scale that the title of the view says, from the middle of the tool.
    row = int(recording.contact.max_depth_m.argmax())
    assert np.linalg.norm(recording.contact.force_n[row]) > 0.1
    for name, wrench in (("contact", recording.contact), ("command", recording.command)):
        assert np.allclose(rrd.array(f"/world/{name}_force", "Arrows3D:vectors") * newtons_per_metre, wrench.force_n, atol=1e-6)
        assert np.allclose(rrd.array(f"/world/{name}_torque", "Arrows3D:vectors") * newtons_per_metre, wrench.torque_nm * 100, atol=1e-6)
    vertices = np.array([line.split()[1:4] for line in (REPOSITORY / "config/models/peg.obj").read_text().splitlines() if line.startswith("v ")], float)
    middle_m = (vertices.min(axis=0) + vertices.max(axis=0)) / 2 * 1e-3
    # The peg stands upright, within some degrees.
    begin = rrd.array("/world/contact_force", "Arrows3D:origins")[row]
    assert np.allclose(begin, recording.tool.position_m[row] + middle_m, atol=0.002) and abs(middle_m[2]) > 0.004
    texts = [text for (text,) in rrd.column("/events", "TextLog:text")]
    drives = [str(drive).lower() for drive in recording.command.drive]
    turns = [drives[0], *(drive for before, drive in zip(drives, drives[1:]) if drive != before)]
    assert [text.split(" (")[0] for text in texts] == ["scene: peg in hole", *(f"drive: {drive}" for drive in turns)] and "enabled" in turns

    shown = rrd.shown()
    for wanted in ("3D", "TimeSeries", "TextLog", f"1 m is {newtons_per_metre:g} N", "contact force, N, world axes", "depth, mm", "/wrench/command/force_n"):
        assert wanted in shown, wanted


def test_arrows_of_the_command_are_turned_and_scaled_into_the_world(peg: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recording = recordings.load(peg)
    (scene,) = recording.scenes
    resolved = deepcopy(scene.resolved)
    # The arm's x axis is the world's y axis.
    world_from_device = {"orientation_xyzw": [0, 0, 0.5**0.5, 0.5**0.5], "position_m": [0, 0, 0]}
    resolved["parameters"]["port"] |= {"scale": 4.0, "world_from_device": world_from_device}
    turned = replace(recording, scenes=(replace(scene, resolved=resolved),))
    monkeypatch.setattr(hapticd_rerun, "load", lambda _path: turned)
    assert convert(peg, tmp_path / "turned.rrd").newtons_per_metre == 25
    rrd = Rrd(tmp_path / "turned.rrd")
    x, y, z = recording.command.force_n.T
    assert np.allclose(rrd.array("/world/command_force", "Arrows3D:vectors") * 25, np.column_stack([-y, x, z]), atol=1e-6) and np.abs(y).max() > 0.1
    assert np.allclose(rrd.array("/world/contact_force", "Arrows3D:vectors") * 25, recording.contact.force_n, atol=1e-6)
    same_as(rrd, recording)


def test_turns_are_those_of_quaternions() -> None:
    random = np.random.default_rng(22)
    (a, b), v = random.normal(size=(2, 4)), random.normal(size=3)
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    rotated, product, conjugate = hapticd_rerun._rotated, hapticd_rerun._product, hapticd_rerun._conjugate
    assert np.allclose(rotated(product(a, b), v), rotated(a, rotated(b, v)))
    assert np.allclose(rotated(conjugate(a), rotated(a, v)), v) and not np.allclose(rotated(a, v), v)
    assert np.allclose(rotated(np.array([0.5, 0.5, 0.5, 0.5]), np.array([1.0, 2.0, 3.0])), [3, 1, 2])


@pytest.mark.parametrize("top_scale, share_of_cylinder", [(1.0, 1.0), (0.0, 1 / 3)])
def test_cylinders_and_cones_are_closed_with_their_outside_out(top_scale: float, share_of_cylinder: float) -> None:
    gray = SimpleNamespace(r=0.5, g=0.5, b=0.5, a=1.0)
    mesh = hapticd_rerun._cylinder(SimpleNamespace(bottom_scale=1.0, top_scale=top_scale, color=gray))
    vertices = np.array(mesh.vertex_positions.as_arrow_array().to_pylist())
    corners = vertices[np.array(mesh.triangle_indices.as_arrow_array().to_pylist())]
    volume = np.linalg.det(corners).sum() / 6
    # A circle of 48 corners has 0.3 % less area.
    assert volume == pytest.approx(np.pi / 4 * share_of_cylinder, rel=0.004)
    assert np.allclose(vertices.min(axis=0), -0.5, atol=1e-6) and vertices[:, 2].max() == 0.5


def test_the_vertices_of_mesh_files_are_found() -> None:
    triangle = np.array([[0, 0, 0], [2, 0, 0], [0, 4, 6]], "<f4")
    binary = bytes(80) + (1).to_bytes(4, "little") + bytes(12) + triangle.tobytes() + bytes(2)
    text = "solid a\n facet normal 0 0 1\n outer loop\n" + "".join(f"  vertex {x} {y} {z}\n" for x, y, z in triangle) + " endloop\n endfacet\nendsolid\n"
    obj = "".join(f"v {x} {y} {z}\n" for x, y, z in triangle) + "vn 9 9 9\nf 1 2 3\n"
    for media_type, data in (("model/stl", binary), ("model/stl", text.encode()), ("model/obj", obj.encode())):
        found = hapticd_rerun._vertices(media_type, data)
        assert found is not None and np.array_equal(found, triangle), media_type
    assert hapticd_rerun._vertices("model/gltf-binary", b"glTF") is None and hapticd_rerun._vertices("model/obj", b"# empty") is None


def test_parts_that_move_are_seen_to_move(tmp_path: Path) -> None:
    file = recorded("run", LIFT, tmp_path / "lift.mcap", "--duration", "2s", "--move", f"lift={REPOSITORY / 'config/scenes/moves/lift.csv'}")
    convert(file, tmp_path / "lift.rrd")
    rrd, recording = Rrd(tmp_path / "lift.rrd"), recordings.load(file)
    same_as(rrd, recording)
    moved = rrd.array("/world/parts/0/lift", "Transform3D:translation")
    assert len(moved) == 1 + len(recording.objects.tick) > 300
    assert np.array_equal(moved[1:], recording.objects.position_m.astype(np.float32)) and moved[-1, 2] == pytest.approx(0.004, abs=1e-4)
    assert rrd.column("/world/parts/0/lift", "tick")[1:] == recording.objects.tick.tolist()
    # A plane is a box below its top face; the tool is a box of 20 mm.
    plane, half = "/world/parts/0/lift/shape", rrd.array("/world/tool/0/shape", "Boxes3D:half_sizes")
    assert rrd.array(plane, "Transform3D:translation")[0, 2] == pytest.approx(-rrd.array(plane, "Boxes3D:half_sizes")[0, 2])
    assert np.allclose(half, 0.01)


def test_clay_is_said_to_be_missing(tmp_path: Path) -> None:
    file = recorded("sculpt", BALL, tmp_path / "clay.mcap", "--duration", "2s")
    converted = convert(file, tmp_path / "clay.rrd")
    rrd, recording = Rrd(tmp_path / "clay.rrd"), recordings.load(file)
    assert converted.notes == ("the surface of clay is not in a recording",) and converted.ticks == len(recording)
    same_as(rrd, recording)
    assert np.allclose(rrd.array("/world/tool/0/shape", "Ellipsoids3D:half_sizes"), 0.003)
    assert not any(path.startswith("/world/parts") for path in rrd.paths)


def test_another_scene_takes_the_place_of_the_first_on_the_wall_clock(tmp_path: Path, state_home: Path) -> None:
    begun_s = time.time()
    with Run(LIFT, *OPTIONS) as run, run.connect() as arm:
        arm.enable()
        arm.wait_until(lambda state: state.phase == "enabled")
        arm.record("for-rerun")
        arm.switch("block-on-plane")
        arm.wait_until(lambda state: state.scene_idx == 1)
        file = arm.end_recording().file
    convert(file, tmp_path / "two.rrd")
    rrd, recording = Rrd(tmp_path / "two.rrd"), recordings.load(file)
    same_as(rrd, recording)
    assert recording.timing.tick[0] > 0 and recording.began_ns is not None
    # Seconds since 1970 have no more than some tenths of a microsecond as a float.
    clock_ns = np.array(rrd.column("/world/tool", "wall_clock"), dtype=np.int64)
    assert begun_s < clock_ns[0] * 1e-9 < clock_ns[-1] * 1e-9 < time.time()
    assert (clock_ns[-1] - clock_ns[0]) * 1e-9 == pytest.approx(np.ptp(recording.timing.time_s))
    assert {"/world/parts/0/lift", "/world/parts/1/plane", "/world/tool/0/shape", "/world/tool/1/shape"} <= rrd.paths, rrd.paths
    switched = recording.timing.tick[int((recording.timing.scene_idx == 1).argmax())]
    for path in ("/world/parts/0", "/world/tool/0"):
        assert rrd.column(path, "Clear:is_recursive") == [[True]] and rrd.column(path, "tick") == [switched]


def cut(whole: Path, n_bytes: int, folder: Path) -> Path:
    file = folder / "cut.mcap"
    file.write_bytes(whole.read_bytes()[:n_bytes])
    return file


def test_what_is_whole_of_a_recording_that_was_cut_is_converted(peg: Path, tmp_path: Path) -> None:
    file = cut(peg, peg.stat().st_size * 2 // 3, tmp_path)
    converted = convert(file, tmp_path / "cut.rrd")
    recording = recordings.load(file)
    assert 100 < len(recording) < len(recordings.load(peg))
    assert converted.notes == (f"{file} has no end, it was cut off: its {len(recording)} whole ticks were converted",)
    same_as(Rrd(tmp_path / "cut.rrd"), recording)


def test_nothing_is_written_that_is_not_whole(peg: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "out.rrd"
    out.write_text("mine")
    with pytest.raises(FileExistsError, match="out.rrd: exists already"):
        convert(peg, out)
    text = tmp_path / "text.mcap"
    text.write_text("not a recording")
    with pytest.raises(RecordingError, match="text.mcap: no MCAP file"):
        convert(text, out, overwrite=True)
    with pytest.raises(FileNotFoundError, match="missing: there is no such folder"):
        convert(peg, tmp_path / "missing" / "out.rrd")
    with pytest.raises(ValueError, match="newtons_per_metre"):
        convert(peg, out, overwrite=True, newtons_per_metre=0)

    def ends(*_args: Any, **_options: Any) -> Iterator[None]:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(rr.Arrows3D, "columns", ends)
        with pytest.raises(KeyboardInterrupt):
            convert(peg, out, overwrite=True)
    # A file of Rerun that lacks its end, as a full disk leaves it.
    monkeypatch.setattr(hapticd_rerun._Log, "write", lambda _self, path: path.write_bytes(b"RRF2" * 100))
    with pytest.raises(OSError, match="out.rrd: could not be written whole"):
        convert(peg, out, overwrite=True)
    assert out.read_text() == "mine" and {path.name for path in tmp_path.iterdir()} == {"out.rrd", "text.mcap"}


def test_the_command_says_what_it_did(peg: Path, tmp_path: Path) -> None:
    def command(*arguments: str | Path, path: str = "") -> subprocess.CompletedProcess[str]:
        line: list[str | Path] = [sys.executable, "-m", "hapticd.rerun", *arguments]
        environment = {**os.environ, "PYTHONPATH": path}
        return subprocess.run(line, capture_output=True, text=True, timeout=HUNG_S, env=environment, check=False)

    file, out = cut(peg, peg.stat().st_size // 2, tmp_path), tmp_path / "out.rrd"
    first, again = command(file, out), command(file, out)
    assert first.returncode == 0 and f"{out}: " in first.stdout and "note: " in first.stderr and "was cut off" in first.stderr, first
    assert again.returncode == 2 and "error: " in again.stderr and "--overwrite" in again.stderr and "Traceback" not in again.stderr
    assert command(file, out, "--overwrite").returncode == 0 and Rrd(out).chunks
    refused = command(Path(__file__), tmp_path / "no.rrd")
    assert refused.returncode == 1 and "test_rerun.py: no MCAP file" in refused.stderr and "Traceback" not in refused.stderr
    # As if it were not installed.
    (tmp_path / "rerun.py").write_text("raise ImportError('not here')")
    without = command(file, out, path=str(tmp_path))
    assert without.returncode == 1 and "pip install 'hapticd[rerun]'" in without.stderr and "Traceback" not in without.stderr
