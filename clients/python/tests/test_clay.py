"""Clay against a real studio."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from conftest import BALL, HUNG_S

from hapticd import Client, ClayPoints, Conflict, Invalid, Pose, Run, Unknown

KINDS: dict[Literal["points", "session", "export"], bytes] = {"points": b"ply", "export": b"ply", "session": b""}


def points(arm: Client) -> ClayPoints:
    found = arm.clay.points()
    assert found is not None
    return found


def test_what_is_pulled_comes_back(state_home: Path) -> None:
    with Run(BALL, "--hand-repeat", "--cache", "off", "--realtime", "best-effort", command="sculpt") as run, run.connect(timeout_s=HUNG_S) as arm:
        arm.wait_until(lambda state: state.phase == "enabled")
        facts = arm.clay.facts()
        before = points(arm)
        assert arm.scene().clay and facts.craft in facts.crafts and facts.samples == before.n_all == len(before.positions_m)
        assert facts.undo == 0
        assert np.allclose(np.linalg.norm(before.positions_m, axis=1), 0.015, atol=0.001), "a ball of 15 mm"
        assert np.allclose(np.linalg.norm(before.normals, axis=1), 1, atol=0.02)
        assert np.all(np.sum(before.normals * before.positions_m, axis=1) > 0), "normals point out of the material"
        assert arm.clay.points(since=before.version) is None

        with pytest.raises(Conflict):
            arm.clay.undo()
        with pytest.raises(Invalid, match="brush_m"):
            arm.clay.take(brush_m=1.0)
        with pytest.raises(Invalid, match="knead"):
            arm.clay.take("knead")

        arm.clay.take("pull", brush_m=0.006, falloff="gaussian")
        arm.clay.wait_until(lambda facts: facts.craft == "pull")
        arm.wait_until(lambda state: state.tool_cp.p[2] < 0.0195)
        with arm.clay.hold():
            arm.clay.wait_until(lambda facts: facts.is_held)
            arm.wait_until(lambda state: state.tool_cp.p[2] > 0.023)
        arm.clay.wait_until(lambda facts: facts.undo == 1 and not facts.is_held and not facts.is_stroke)
        pulled = points(arm)
        assert pulled.version > before.version
        assert pulled.positions_m[:, 2].max() > before.positions_m[:, 2].max() + 0.001

        arm.clay.undo()
        arm.clay.wait_until(lambda facts: facts.redo == 1)
        assert np.array_equal(points(arm).positions_m, before.positions_m), "undo gives the samples back"
        arm.clay.redo()
        arm.clay.wait_until(lambda facts: facts.redo == 0)
        assert np.array_equal(points(arm).positions_m, pulled.positions_m)

        arm.clay.take("paint", color="#2060e0", falloff=[1.0, 0.5, 0.0])
        arm.clay.wait_until(lambda facts: facts.falloff == "table" and facts.color == "#2060e0")


def test_curves_material_region_image_and_solid_are_chosen(state_home: Path) -> None:
    with Run(BALL, "--cache", "off", "--realtime", "best-effort", command="sculpt") as run, run.connect(timeout_s=HUNG_S) as arm:
        arm.wait_until(lambda state: state.phase == "enabled")
        before = points(arm)
        top = [0.0, 0.0, 0.015]
        arm.clay.take("pull-curve", brush_m=0.004)
        arm.clay.draw([np.array([[-0.003, 0.0, 0.015], [0.003, 0.0, 0.015]])])
        assert len(arm.clay.wait_until(lambda facts: len(facts.curves_map) == 1).curves_map[0]) > 2
        arm.clay.pull([[top]], [0.0, 0.0, 3.0], 0.2)
        arm.clay.wait_until(lambda facts: facts.undo == 1 and not facts.is_stroke)
        assert points(arm).positions_m[:, 2].max() > before.positions_m[:, 2].max()
        arm.clay.lay({"stiffness_n_per_m": 321.0})
        assert arm.clay.wait_until(lambda facts: facts.undo == 2).material["stiffness_n_per_m"] == 321.0
        arm.clay.lay(ball=(top, 0.004))
        arm.clay.combine("difference", {"sphere_m": 0.004}, Pose(np.array([0.0, 0.0, 0.015]), np.array([0.0, 0.0, 0.0, 1.0])))
        arm.clay.region([-0.006, -0.006, 0.008], [0.006, 0.006, 0.02])
        arm.clay.wait_until(lambda facts: facts.undo == 4 and float(facts.region_map[0][0]) > -0.007)
        arm.clay.solid(b"v 0 0 0\nv 6 0 0\nv 0 6 0\nv 0 0 6\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n", "obj")
        assert "4 triangles" in str(arm.clay.wait_until(lambda facts: facts.solid is not None).solid)
        arm.clay.solid(None)
        arm.clay.wait_until(lambda facts: facts.solid is None)
        with pytest.raises(Invalid, match="PNG"):
            arm.clay.image(b"GIF89a")
        with pytest.raises(Conflict, match="surface"):
            arm.clay.draw([[[0.0, 0.0, 1.0]]])


def test_a_hold_lasts_as_long_as_its_block_and_files_are_written_once(state_home: Path) -> None:
    with Run(BALL, "--cache", "off", "--realtime", "best-effort", command="sculpt") as run, run.connect(timeout_s=HUNG_S) as arm:
        arm.wait_until(lambda state: state.phase == "enabled")
        arm.clay.take("emboss", brush_m=0.008, depth_m=0.001)
        with run.connect() as other, arm.clay.hold():
            time.sleep(1.5)
            assert arm.clay.facts().is_held, "longer than a silence may be"
            with pytest.raises(Conflict), other.clay.hold():
                pass
        arm.clay.wait_until(lambda facts: not facts.is_held)
        for kind, begin in KINDS.items():
            file = Path(arm.clay.save(kind, f"ball {kind}"))
            assert file.is_relative_to(state_home) and file.read_bytes().startswith(begin) and file.stat().st_size > 1000
            with pytest.raises(Conflict, match="exists already"):
                arm.clay.save(kind, f"ball {kind}")
        with pytest.raises(Invalid, match="letters"):
            arm.clay.save("points", "../ball")
        arm.disable()
        arm.wait_until(lambda state: state.state == "DISABLED" and not state.is_busy)
        with pytest.raises(Conflict, match="enable first"), arm.clay.hold():
            pass


def test_there_is_none_in_a_rigid_scene(arm: Client) -> None:
    for asked in (arm.clay.facts, arm.clay.points, arm.clay.undo):
        with pytest.raises(Unknown, match="clay"):
            asked()


def test_samples_are_read_by_their_layout() -> None:
    head = b"HCLY" + (1).to_bytes(4, "little") + (7).to_bytes(8, "little") + (1).to_bytes(4, "little") + (3).to_bytes(4, "little")
    data = head + np.float32(0.5).tobytes() + bytes(4) + np.array([1, 2, 3], "<f4").tobytes() + bytes([0, 0, 127, 0]) + bytes([10, 20, 255, 0])
    found = ClayPoints.from_bytes(data)
    assert (found.version, found.n_all, found.spacing_m) == (7, 3, 0.5)
    assert found.positions_m.tolist() == [[1, 2, 3]] and found.normals.tolist() == [[0, 0, 1]] and found.colors.tolist() == [[10, 20, 255]]
    for wrong in (b"", data[:-1], b"HCLX" + data[4:]):
        with pytest.raises(ValueError):
            ClayPoints.from_bytes(wrong)
