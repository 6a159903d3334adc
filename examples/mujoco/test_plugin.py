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
from numpy.typing import NDArray

FOLDER = Path(__file__).parent


def text_of(name: str) -> str:
    return (FOLDER / name).read_text().replace("../../config/models", str(FOLDER.parents[1] / "config/models"))


MODEL, NUT = text_of("peg_in_hole.xml"), text_of("nut_on_bolt.xml")
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


def load(text: str = MODEL, **changes: str) -> tuple[Any, Any]:
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


def spin_of_the_nut(steps: int, **changes: str) -> tuple[Any, NDArray[np.float64]]:
    """The model, and how fast the nut turns about the bolt after each step, rad/s."""
    model, data = load(NUT, **changes)
    spin = np.zeros(steps)
    for step in range(steps):
        mujoco.mj_step(model, data)
        spin[step] = -data.qvel[5]
    # The thread leads it: it falls by a pitch of 1 mm a turn, within the play.
    assert data.qpos[2] - 0.013 == pytest.approx(-1e-3 * spin.sum() * model.opt.timestep / (2 * np.pi), abs=6e-5)
    return model, spin


def acceleration(model: Any, spin: NDArray[np.float64]) -> float:
    """How fast the spin of the nut grows in the mean of the last two thirds, by what the textbook says without friction."""
    times = model.opt.timestep * np.arange(len(spin))
    rest = len(spin) // 3
    of_turn = np.polyfit(times[rest:], spin[rest:], 1)[0]
    nut, per_turn = model.body("nut"), 2 * np.pi / 1e-3
    return float(of_turn * (1 + nut.inertia.max() / nut.mass[0] * per_turn**2) / (9.81 * per_turn))


def test_a_nut_without_friction_falls_as_the_textbook_says() -> None:
    model, spin = spin_of_the_nut(1500)
    assert spin[-1] > 15 and acceleration(model, spin) == pytest.approx(1, abs=0.01)


def test_a_nut_locks_above_the_friction_that_its_helix_asks_for_and_runs_below() -> None:
    # Pitch over circumference at the pitch diameter; the flanks lean by 30°.
    locks_at = np.cos(np.pi / 6) / (np.pi * (8 - 0.75 * np.sqrt(0.75)))
    assert locks_at == pytest.approx(0.0375, abs=1e-4)
    model, runs = spin_of_the_nut(1500, friction=f"{locks_at - 0.003}")
    assert runs[-1] > 1.0 and acceleration(model, runs) > 0.03
    _, locked = spin_of_the_nut(1500, friction=f"{locks_at + 0.003}")
    # What its fall through the play gave it is gone; below the slip speed friction is viscous: it creeps on, by a turn in two minutes.
    assert (locked[1000:] < 0.06).all()


def test_friction_is_that_of_coulomb_against_what_slides() -> None:
    model, data = load(friction="0.3", dissipation="0")

    def force_n(speed_m_per_s: float) -> NDArray[np.float64]:
        # The tip of the peg alone touches, on the floor of the hole.
        data.qpos[:3], data.qvel[0] = [0, 0, -0.0201], speed_m_per_s
        mujoco.mj_forward(model, data)
        return np.array(data.sensor("wrench").data[:3])

    still, fast, slow = force_n(0), force_n(0.1), force_n(-1e-4)
    assert abs(still[0]) < 1e-4 * still[2]
    # The bevel of the tip pushes aside as well: its sides cancel, their friction does not.
    assert fast == pytest.approx([-0.3 * still[2], 0, still[2]], abs=1e-2 * still[2])
    # Below the slip speed in proportion: a step takes half of the speed away.
    assert slow[0] == pytest.approx(0.08 * 1e-4 / (2 * model.opt.timestep), rel=2e-2)


def test_a_time_step_that_is_too_long_is_said_once() -> None:
    said: list[str] = []
    mujoco.set_mju_user_warning(said.append)
    try:
        model, data = load(NUT)
        for _ in range(400):
            mujoco.mj_step(model, data)
        assert said == []
        model, data = load(NUT, stiffness="400")
        while not said and data.time < 0.1:
            mujoco.mj_step(model, data)
        # Stiffest at the bottom of its first fall through the play.
        data.qpos[2], data.qvel[:] = 0.01293, 0
        mujoco.mj_forward(model, data)
        assert len(said) == 1
    finally:
        mujoco.set_mju_user_warning(None)
    assert re.search(r"time step of 0.0002 s is too long for a contact of .* N/m: take one below 0.0001", said[0])


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"touched": "bloc"}, 'touched = "bloc" names no geom'),
        ({"voxel_size": "fine"}, 'voxel_size = "fine": give a number'),
        ({"voxel_size": "0"}, "voxel_size_m is 0"),
        ({"point_spacing": "-1"}, 'point_spacing = "-1": give a number'),
        ({"stiffness": "1e20"}, "stiffness"),
        ({"friction": "-0.1"}, 'friction = "-0.1": give a number'),
    ],
)
def test_what_is_wrong_is_said(changes: dict[str, str], text: str) -> None:
    with pytest.raises(ValueError, match=re.escape(text)):
        load(**changes)
