"""Baking, files and views."""

import errno
import gc
import multiprocessing
import os
import pickle
import signal
import threading
import time
from pathlib import Path
from typing import Any

import hapticd_vps as vps
import numpy as np
import pytest
from conftest import VOXEL_M, box
from numpy.typing import NDArray

POSE = [0.001, 0.002, 0.0098, 0, 0, 0, 1]


def test_saved_parts_give_the_same_bits(tmp_path: Path, block: vps.Voxmap, cube: vps.PointShell, query: vps.ContactQuery) -> None:
    block.save(tmp_path / "block")
    cube.save(str(tmp_path / "cube"))
    again = vps.ContactQuery(vps.Voxmap.load(tmp_path / "block"), vps.PointShell.load(tmp_path / "cube"), 2000.0)
    assert again.wrench(POSE).tobytes() == query.wrench(POSE).tobytes()


def test_pickled_parts_give_the_same_bits(cube: vps.PointShell, query: vps.ContactQuery) -> None:
    again = pickle.loads(pickle.dumps(query))
    assert again.wrench(POSE).tobytes() == query.wrench(POSE).tobytes() and query.wrench(POSE)["contacts"] > 0
    assert (pickle.loads(pickle.dumps(cube)).positions_m == cube.positions_m)[:-1].all()
    mesh = box([0, 0, 0], [0.01, 0.01, 0.01])
    twin = pickle.loads(pickle.dumps(mesh))
    assert (twin.vertices == mesh.vertices).all() and (twin.faces == mesh.faces).all()
    made = pickle.dumps(vps.Voxmap.bake(mesh, VOXEL_M))
    assert pickle.dumps(vps.Voxmap.bake(twin, VOXEL_M)) == made
    # In another process, which has no memory of this one.
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.apply(vps.ContactQuery.wrench, (query, [POSE])).tobytes() == query.wrench([POSE]).tobytes()
    for pickled in (made[:-200] + made[-100:], made.replace(b"warnings", b"warmings")):
        with pytest.raises((ValueError, pickle.UnpicklingError, EOFError)):
            pickle.loads(pickled)


def test_what_a_bake_warns_of_is_a_warning() -> None:
    sheet = vps.Mesh(np.array([[0, 0, 0], [0.01, 0, 0], [0, 0.01, 0]]), np.array([[0, 1, 2]]))
    with pytest.warns(UserWarning) as heard:
        voxmap = vps.Voxmap.bake(sheet, VOXEL_M)
    assert [str(warning.message) for warning in heard] == voxmap.warnings and len(heard) > 0
    assert heard[0].filename == __file__


def test_files_that_are_none(tmp_path: Path, block: vps.Voxmap) -> None:
    with pytest.raises(vps.FileError, match="none: ") as raised:
        vps.Voxmap.load(tmp_path / "none")
    assert isinstance(raised.value, OSError) and raised.value.errno == errno.ENOENT
    with pytest.raises(vps.FileError, match="no such file") as raised:
        vps.Mesh.load(tmp_path / "none.obj", 1e-3)
    assert raised.value.errno == errno.ENOENT and str(tmp_path) in str(raised.value.strerror)
    with pytest.raises(vps.FileError, match="cannot be written") as raised:
        block.save(tmp_path / "no-folder" / "block")
    assert raised.value.errno == errno.ENOENT
    block.save(tmp_path / "block")
    with pytest.raises(vps.FileError, match="holds no pointshell") as raised:
        vps.PointShell.load(tmp_path / "block")
    assert raised.value.errno is None
    whole = (tmp_path / "block").read_bytes()
    for name, damaged in {"cut": whole[: len(whole) // 2], "other": b"solid x" * 100, "empty": b""}.items():
        (tmp_path / name).write_bytes(damaged)
        with pytest.raises(vps.FileError, match=name):
            vps.Voxmap.load(tmp_path / name)


def test_mesh_files_in_their_unit(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 10 0 0\nv 0 10 0\nv 0 0 10\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    mesh = vps.Mesh.load(tmp_path / "a.obj", 1e-3)
    assert mesh.vertices.shape == (4, 3) and mesh.vertices.max() == 0.01 and mesh.volume_m3 == pytest.approx(1e-6 / 6)
    (tmp_path / "b.obj").write_text("v 0 0 0\nv x 0 0\n")
    with pytest.raises(vps.InvalidInput, match="b.obj.*2"):
        vps.Mesh.load(tmp_path / "b.obj", 1e-3)


def test_a_mesh_tells_its_bodies_and_hollows() -> None:
    shells = [box([0, 0, 0], [0.04, 0.04, 0.04]), box([0.005] * 3, [0.035] * 3), box([0.1, 0, 0], [0.11, 0.01, 0.01])]
    vertices = np.concatenate([shell.vertices for shell in shells])
    firsts = np.cumsum([0] + [len(shell.vertices) for shell in shells[:-1]])
    faces = [shell.faces.astype(np.int64) + first for shell, first in zip(shells, firsts)]
    faces[1] = faces[1][:, ::-1]
    housing = vps.Mesh(vertices, np.concatenate(faces))
    assert (housing.n_pieces, housing.n_bodies, housing.n_open_pieces) == (3, 2, 0)
    assert housing.cavities_m3 == [pytest.approx(0.03**3)]
    assert housing.volume_m3 == pytest.approx(0.04**3 - 0.03**3 + 0.01**3)
    assert any("hollow" in warning for warning in housing.warnings)
    sheet = vps.Mesh(np.array([[0, 0, 0], [0.01, 0, 0], [0, 0.01, 0]]), np.array([[0, 1, 2]]))
    assert (sheet.n_pieces, sheet.n_bodies, sheet.n_open_pieces) == (1, 0, 1)


def test_a_bake_says_what_it_tells_apart() -> None:
    mesh = box([0, 0, 0], [0.02, 0.014, 0.006])
    voxmap = vps.Voxmap.bake(mesh, 0.5e-3)
    shell = vps.PointShell.bake(mesh, 0.5e-3)
    of_voxmap = voxmap.accuracy
    assert of_voxmap["thinnest_wall_m"] == pytest.approx(0.006)
    assert of_voxmap["sharpest_edge_deg"] == pytest.approx(90)
    error_m = of_voxmap["sample_error_m"]
    assert error_m is not None and error_m < 1e-4 * 0.5e-3
    assert of_voxmap["unseen_depth_m"] is None
    unseen_m = shell.accuracy["unseen_depth_m"]
    assert unseen_m is not None and 0 <= unseen_m < 0.5e-3


def test_progress_names_the_stages() -> None:
    mesh, heard = box([0, 0, 0], [0.01, 0.01, 0.01]), dict[str, float]()
    for bake, last in ((vps.Voxmap.bake, ["distance", "field"]), (vps.PointShell.bake, ["pointshell"])):
        heard.clear()
        bake(mesh, VOXEL_M, progress=heard.__setitem__)
        assert list(heard) == ["surface", "fill", "layers", *last, "report", "done"]
        shares = list(heard.values())
        assert shares[0] == 0 and shares[-1] == 1 and shares == sorted(set(shares))


def test_progress_and_signals_end_a_bake() -> None:
    mesh, heard = box([0, 0, 0], [0.01, 0.01, 0.01]), list[str]()

    def enough(stage: str, _: float) -> None:
        heard.append(stage)
        if stage == "fill":
            raise LookupError("enough")

    def interrupted(stage: str, _: float) -> None:
        heard.append(stage)
        signal.raise_signal(signal.SIGINT)

    with pytest.raises(LookupError, match="enough"):
        vps.Voxmap.bake(mesh, VOXEL_M, progress=enough)
    assert heard == ["surface", "fill"]
    heard.clear()
    with pytest.raises(KeyboardInterrupt):
        vps.PointShell.bake(mesh, VOXEL_M, progress=interrupted)
    assert heard == ["surface"]


def test_ctrl_c_is_raised_within_a_stage() -> None:
    """Half a million triangles, whose distances take seconds: it need not wait for them."""
    n = 500
    i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    turn, tilt = 2 * np.pi * i / n, 2 * np.pi * j / n
    ring = 0.1 + (0.04 + 1e-3 * np.sin(40 * turn)) * np.cos(tilt)
    vertices = np.stack([ring * np.cos(turn), ring * np.sin(turn), 0.04 * np.sin(tilt)], axis=-1).reshape(-1, 3)

    a, b, c, d = (((i + x) % n * n + (j + y) % n).ravel() for x, y in ((0, 0), (1, 0), (1, 1), (0, 1)))
    mesh = vps.Mesh(vertices, np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]))
    stages = list[str]()

    def interrupt() -> None:
        while "distance" not in stages:
            time.sleep(0.001)
        time.sleep(0.02)
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        vps.Voxmap.bake(mesh, 2.5e-4, layers=30, progress=lambda stage, _: stages.append(stage))
    # Threads are at work on the stage still.
    busy_s, until_s = time.process_time() + 0.1, time.monotonic() + 10
    while time.process_time() < busy_s and time.monotonic() < until_s:
        time.sleep(0.02)
    assert time.process_time() >= busy_s
    thread.join()
    assert stages[-1] == "distance"


def test_views_are_the_memory_and_outlive_the_part() -> None:
    mesh = box([0, 0, 0], [0.01, 0.01, 0.01])
    voxmap, shell = vps.Voxmap.bake(mesh, VOXEL_M), vps.PointShell.bake(mesh, VOXEL_M)
    views: dict[str, tuple[NDArray[Any], NDArray[Any]]] = {
        "vertices": (mesh.vertices, mesh.vertices),
        "faces": (mesh.faces, mesh.faces),
        "brick_index": (voxmap.brick_index, voxmap.brick_index),
        "positions_m": (shell.positions_m, shell.positions_m),
        "normals": (shell.normals, shell.normals),
        "half_axes_m": (shell.half_axes_m, shell.half_axes_m),
        "weights": (shell.weights, shell.weights),
    }
    for name, (view, again) in views.items():
        assert np.shares_memory(view, again), name
        assert not view.flags.writeable and not view.flags.owndata, name
        with pytest.raises(ValueError):
            view.flags.writeable = True
    copies = {name: view.copy() for name, (view, _) in views.items()}
    del mesh, voxmap, shell
    gc.collect()
    _ = [np.full(10_000, 7.0) for _ in range(1000)]
    for name, (view, _) in views.items():
        assert view.tobytes() == copies[name].tobytes(), name


def test_what_the_views_hold(block: vps.Voxmap, cube: vps.PointShell) -> None:
    # Each sample of a brick is the depth that the look-up gives at the centre of its voxel, which ends at the band.
    index, bricks = block.brick_index, block.bricks
    assert bricks.shape[1:] == (9, 9, 9)
    places = np.argwhere(index < len(bricks))
    assert len(places) == len(bricks)
    for place in places[:: len(places) // 20]:
        center_m = block.origin_m + (8 * place + [3, 4, 5] + np.array(0.5)) * block.voxel_size_m
        sample_m = np.clip(bricks[index[tuple(place)], 3, 4, 5], -block.band_m, block.band_m)
        assert -block.distance(center_m)[0] == pytest.approx(float(sample_m), abs=1e-7)
    assert set(index[index >= len(bricks)]) <= {vps.Voxmap.FAR_OUTSIDE, vps.Voxmap.DEEP_INSIDE}
    # The points of the cube lie on its surface, their normals point into it, their areas add up.
    points, normals = (array.reshape(-1, 3)[: len(cube)] for array in (cube.positions_m, cube.normals))
    assert np.isnan(cube.positions_m.reshape(-1, 3)[len(cube) :]).all()
    assert np.abs(points).max(axis=1) == pytest.approx(0.005, abs=1e-6)
    assert ((points * normals).sum(axis=1) < 0).all() and np.linalg.norm(normals, axis=1) == pytest.approx(1, abs=1e-5)
    area_m2 = cube.weights.reshape(-1)[: len(cube)].sum() * cube.voxel_size_m**2
    assert area_m2 == pytest.approx(6 * 0.01**2, rel=0.02) and cube.center_of_mass_m == pytest.approx([0.005] * 3)
