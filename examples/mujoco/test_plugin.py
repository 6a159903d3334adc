"""The plug-in beside closed forms and the Python package. HAPTICD_MUJOCO_PLUGIN names the shared object."""

import copy
import os
import re
from pathlib import Path
from typing import Any

import hapticd_vps as vps
import mujoco
import numpy as np
import pytest

FOLDER = Path(__file__).parent
MODEL = (FOLDER / "peg_in_hole.xml").read_text().replace("../../config/models", str(FOLDER.parents[1] / "config/models"))
WEIGHT_N = 0.08 * 9.81

mujoco.mj_loadPluginLibrary(os.environ["HAPTICD_MUJOCO_PLUGIN"])


def test_the_example_of_the_readme_weighs_the_peg(monkeypatch: pytest.MonkeyPatch) -> None:
    found = re.search(r"```python\n(.*?)```", (FOLDER / "README.md").read_text(), re.S)
    assert found and "./libhapticd_mujoco.so" in found[1]
    monkeypatch.chdir(FOLDER.parents[1])
    names: dict[str, Any] = {}
    exec(found[1].replace("./libhapticd_mujoco.so", os.environ["HAPTICD_MUJOCO_PLUGIN"]), names)
    # Without friction it goes on swaying in its play: walls push to the side when it meets them.
    assert names["data"].sensor("wrench").data[2] == pytest.approx(WEIGHT_N, rel=2e-3)


def load(**changes: str) -> tuple[Any, Any]:
    text = MODEL
    for key, value in changes.items():
        old = f'key="{key}" value="'
        assert text.count(old) == 1
        begin = text.index(old) + len(old)
        text = text[:begin] + value + text[text.index('"', begin) :]
    model = mujoco.MjModel.from_xml_string(text)
    return model, mujoco.MjData(model)


def direct(model: Any, data: Any) -> vps.ContactQuery:
    """The same query by the Python package."""

    def mesh(name: str) -> vps.Mesh:
        mesh = model.mesh(name)
        vertices = model.mesh_vert[mesh.vertadr[0] :][: mesh.vertnum[0]]
        return vps.Mesh(vertices, model.mesh_face[mesh.faceadr[0] :][: mesh.facenum[0]])

    return vps.ContactQuery(vps.Voxmap.bake(mesh("block"), 2e-4), vps.PointShell.bake(mesh("peg"), 4e-4), 50.0)


def test_the_peg_falls_into_the_hole_and_its_weight_is_carried() -> None:
    model, data = load()
    forces = []
    for step in range(3000):
        mujoco.mj_step(model, data)
        if step >= 2600:
            forces.append(data.sensor("wrench").data[:3].copy())
    # On the floor of the hole, 20 mm deep, and within the play of 0.05 mm.
    assert data.qpos[2] == pytest.approx(-20e-3, abs=2e-4)
    assert np.hypot(*data.qpos[:2]) < 7e-5
    assert np.mean(forces, axis=0) == pytest.approx([0, 0, WEIGHT_N], abs=2e-3 * WEIGHT_N)


def test_the_sensor_is_the_query_of_the_package() -> None:
    model, data = load(dissipation="0")
    query = direct(model, data)
    random = np.random.default_rng(24)
    block, peg, touching = data.geom("block"), data.geom("peg"), 0
    for _ in range(100):
        data.qpos[:3] = random.uniform([-1e-3, -1e-3, -0.02], [1e-3, 1e-3, 1e-3])
        data.qpos[3:] = [1, *random.normal(0, 0.02, 3)]
        mujoco.mj_forward(model, data)
        to_world = block.xmat.reshape(3, 3)
        pose = np.eye(4)
        pose[:3, :3] = to_world.T @ peg.xmat.reshape(3, 3)
        pose[:3, 3] = to_world.T @ (peg.xpos - block.xpos)
        found, sensed = query.wrench(pose), data.sensor("wrench").data
        size = float(np.linalg.norm(found["force_n"])) + 1e-6
        assert sensed[:3] == pytest.approx(to_world @ found["force_n"], abs=1e-5 * size)
        assert sensed[3:6] == pytest.approx(to_world @ found["torque_nm"], abs=1e-7 * size)
        assert sensed[6:] == pytest.approx([found["penetration_m"], found["clearance_m"]], abs=1e-9)
        touching += found["contacts"] > 0
    assert touching > 50


def test_the_passive_force_is_what_the_sensor_says() -> None:
    model, data = load()
    data.qpos[:3], data.qpos[3:] = [1e-4, 0, -0.01], [1, 0.01, 0, 0]
    mujoco.mj_forward(model, data)
    sensed = data.sensor("wrench").data
    assert np.linalg.norm(sensed[:3]) > 0.1
    # Of a free joint: force in world axes, torque about the body's origin in its own axes.
    about_body = sensed[3:6] + np.cross(data.geom("peg").xpos - data.body("peg").xpos, sensed[:3])
    assert data.qfrc_passive[:3] == pytest.approx(sensed[:3], rel=1e-9)
    assert data.body("peg").xmat.reshape(3, 3) @ data.qfrc_passive[3:] == pytest.approx(about_body, abs=1e-9)


def test_without_a_body_it_is_a_sensor_only_and_both_parts_feel_the_force() -> None:
    text = MODEL.replace('<plugin instance="peg in block"/>', "", 1)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[2] = -0.0201
    mujoco.mj_forward(model, data)
    assert data.sensor("wrench").data[2] > 0.1 and not data.qfrc_passive.any()

    loose = MODEL.replace('<geom name="block" mesh="block" rgba="0.6 0.65 0.7 1"/>', '<body><freejoint/><geom name="block" mesh="block"/></body>')
    model = mujoco.MjModel.from_xml_string(loose)
    data = mujoco.MjData(model)
    data.qpos[9] = -0.0201
    data.qpos[7] = 1e-4
    mujoco.mj_forward(model, data)
    on_block, on_peg = data.qfrc_passive[:3], data.qfrc_passive[6:9]
    assert np.linalg.norm(on_peg) > 0.1 and on_block == pytest.approx(-on_peg, rel=1e-12)


def test_dissipation_is_that_of_hunt_and_crossley() -> None:
    model, data = load(dissipation="5")
    data.qpos[:3] = [0, 0, -0.0201]

    def lift_n(speed_m_per_s: float) -> float:
        data.qvel[2] = speed_m_per_s
        mujoco.mj_forward(model, data)
        return float(data.sensor("wrench").data[2])

    # The tip alone touches, and the floor of the hole has its gradient along z. The tip's bevel, too, goes as deep as the peg.
    at_rest = lift_n(0)
    assert at_rest > 0.1
    assert lift_n(-0.1) == pytest.approx(1.5 * at_rest, rel=1e-3)
    assert lift_n(0.1) == pytest.approx(0.5 * at_rest, rel=1e-3)
    assert lift_n(0.3) == 0


def test_a_copy_of_the_data_goes_the_same_way() -> None:
    model, data = load()
    for _ in range(300):
        mujoco.mj_step(model, data)
    other = copy.copy(data)
    for _ in range(50):
        mujoco.mj_step(model, data)
        mujoco.mj_step(model, other)
    assert data.sensor("wrench").data[2] > 0.1
    assert (data.sensordata == other.sensordata).all() and (data.qpos == other.qpos).all()
    del other
    mujoco.mj_step(model, data)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"touched": "bloc"}, 'touched = "bloc" names no geom'),
        ({"voxel_size": "fine"}, 'voxel_size = "fine": give a number'),
        ({"voxel_size": "0"}, "voxel_size_m is 0"),
        ({"point_spacing": "-1"}, 'point_spacing = "-1": give a number'),
        ({"stiffness": "1e20"}, "stiffness"),
    ],
)
def test_what_is_wrong_is_said(changes: dict[str, str], text: str) -> None:
    with pytest.raises(ValueError, match=re.escape(text)):
        load(**changes)
