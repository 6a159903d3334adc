"""Wrenches, contacts and distances against closed forms."""

import multiprocessing
import pickle
from concurrent.futures import ThreadPoolExecutor

import hapticd_vps as vps
import numpy as np
import pytest
from conftest import VOXEL_M, box
from numpy.typing import NDArray

IDENTITY = [0.0, 0.0, 0.0, 1.0]


def poses_near_contact(n: int) -> NDArray[np.float64]:
    """Poses of the cube over the block: turned in every direction, half of them in contact."""
    random = np.random.default_rng(24)
    rotations = random.normal(size=(n, 4))
    rotations /= np.linalg.norm(rotations, axis=1, keepdims=True)
    return np.hstack([random.uniform([-0.02, -0.02, 0.008], [0.02, 0.02, 0.02], (n, 3)), rotations])


def matrices(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 4, 4) of (n, 7)."""
    x, y, z, w = poses[:, 3:].T
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix = np.zeros((len(poses), 4, 4))
    matrix[:, :3, :3] = rotation.transpose(2, 0, 1)
    matrix[:, :3, 3] = poses[:, :3]
    matrix[:, 3, 3] = 1
    return matrix


def test_a_face_pushes_as_an_elastic_foundation(query: vps.ContactQuery) -> None:
    depth_m = 2e-4
    found = query.wrench([0.001, 0.002, 0.01 - depth_m, *IDENTITY])
    force_n = 2000.0 * depth_m * 0.01**2 / VOXEL_M**2
    assert found["force_n"] == pytest.approx([0, 0, force_n], rel=0.01, abs=0.01 * force_n)
    # About the corner of the cube: the force acts in the middle of its lower face.
    assert found["torque_nm"] == pytest.approx([0.005 * force_n, -0.005 * force_n, 0], rel=0.01, abs=1e-4 * force_n)
    assert found["penetration_m"] == pytest.approx(depth_m, abs=1e-6)
    assert found["clearance_m"] == 0 and found["contacts"] >= 400


def test_without_contact_there_is_a_clearance(query: vps.ContactQuery, block: vps.Voxmap) -> None:
    near = query.wrench([0, 0, 0.01 + 1e-3, *IDENTITY])
    assert near["clearance_m"] == pytest.approx(1e-3, abs=2e-5)
    assert near["contacts"] == 0 and not near["force_n"].any() and near["penetration_m"] == 0
    assert query.wrench([0, 0, 1, *IDENTITY])["clearance_m"] == block.band_m


def test_many_poses_give_the_bits_of_each(query: vps.ContactQuery) -> None:
    poses = poses_near_contact(5000)
    together = query.wrench(poses)
    assert together.shape == (5000,) and together.dtype == vps.WRENCH_DTYPE
    assert 1000 < np.count_nonzero(together["contacts"]) < 4500
    with ThreadPoolExecutor(4) as threads:
        each = list(threads.map(query.wrench, poses))
    assert together.tobytes() == np.array(each, dtype=vps.WRENCH_DTYPE).tobytes()


def test_a_matrix_is_the_pose_of_its_quaternion(query: vps.ContactQuery) -> None:
    poses = poses_near_contact(200)
    by_quaternion, by_matrix = query.wrench(poses), query.wrench(matrices(poses))
    for column in ("force_n", "torque_nm", "penetration_m", "clearance_m"):
        assert by_matrix[column] == pytest.approx(by_quaternion[column], rel=1e-3, abs=1e-4), column
    assert query.wrench(matrices(poses)[7]) == by_matrix[7]
    # Also where the matrix counts single precision, and as nested lists.
    single = query.wrench(matrices(poses).astype(np.float32).tolist())
    assert single["force_n"] == pytest.approx(by_matrix["force_n"], rel=1e-2, abs=0.1)


def test_contacts_add_up_to_the_wrench(block: vps.Voxmap, query: vps.ContactQuery) -> None:
    touching = 0
    for pose in poses_near_contact(50):
        found, contacts = query.wrench(pose), query.contacts(pose)
        assert contacts.dtype == vps.CONTACT_DTYPE and len(contacts) == found["contacts"]
        arms = contacts["position_m"] - pose[:3]
        size = float(np.linalg.norm(found["force_n"])) + 1e-9
        assert contacts["force_n"].sum(axis=0) == pytest.approx(found["force_n"], abs=1e-4 * size)
        assert np.cross(arms, contacts["force_n"]).sum(axis=0) == pytest.approx(found["torque_nm"], abs=1e-6 * size)
        assert (np.diff(contacts["point"]) > 0).all() and (contacts["depth_m"] > 0).all()
        if len(contacts):
            touching += 1
            assert contacts["depth_m"].max() == pytest.approx(found["penetration_m"], rel=1e-6)
            assert np.linalg.norm(contacts["normal"], axis=1) == pytest.approx(1)
            within_band = contacts["depth_m"] < 0.99 * block.band_m
            assert np.linalg.norm(contacts["gradient"][within_band], axis=1) == pytest.approx(1)
    assert touching > 10


def test_parts_of_one_world_press_as_each_of_them_does(block: vps.Voxmap, cube: vps.PointShell) -> None:
    turned = [0.03, 0.0, 0.005, 0.0, np.sin(0.4), 0.0, np.cos(0.4)]
    parts = [(block, [0, 0, 0, *IDENTITY]), (block, turned)]
    both = vps.ContactQuery(parts, cube, 2000.0)
    alone = vps.ContactQuery(block, cube, 2000.0)
    moved = np.linalg.inv(matrices(np.array([turned]))[0])
    together = 0
    for pose in poses_near_contact(50):
        found = both.wrench(pose)
        one, other = alone.wrench(pose), alone.wrench(moved @ matrices(pose[None])[0])
        force_n = one["force_n"] + matrices(np.array([turned]))[0, :3, :3] @ other["force_n"]
        assert found["force_n"] == pytest.approx(force_n, abs=1e-3 * np.linalg.norm(force_n) + 1e-9)
        assert found["contacts"] == one["contacts"] + other["contacts"]
        assert (both.contacts(pose)["part"] == 1).sum() == other["contacts"]
        together += other["contacts"] > 0
    assert together > 3
    again = pickle.loads(pickle.dumps(both))
    assert again.wrench(pose).tobytes() == both.wrench(pose).tobytes()
    for nonsense in ([], [(block,)], 7):
        with pytest.raises((vps.InvalidInput, TypeError), match="give (a Voxmap, or|1 to 1e6)"):
            vps.ContactQuery(nonsense, cube)  # type: ignore[arg-type]


def test_both_ways_are_half_of_each(block: vps.Voxmap, cube: vps.PointShell) -> None:
    corners = [-0.02, -0.02, -0.01], [0.02, 0.02, 0.01]
    points = vps.PointShell.bake(box(*corners), 7e-4)
    own = vps.Voxmap.bake(box([0, 0, 0], [0.01, 0.01, 0.01]), 4e-4)
    both = vps.ContactQuery.both_ways((block, points), (own, cube), 2000.0)
    there = vps.ContactQuery(block, cube, 2000.0)
    # The same stiffness of an area.
    back = vps.ContactQuery(own, points, 2000.0 * (points.voxel_size_m / cube.voxel_size_m) ** 2)
    touching = 0
    for pose in poses_near_contact(60):
        matrix = matrices(pose[None])[0]
        felt, one, other = both.wrench(pose), there.wrench(pose), back.wrench(np.linalg.inv(matrix))
        turned = {name: matrix[:3, :3] @ other[name] for name in ("force_n", "torque_nm")}
        size = float(np.linalg.norm(one["force_n"]) + np.linalg.norm(other["force_n"])) + 1e-9
        assert felt["force_n"] == pytest.approx((one["force_n"] - turned["force_n"]) / 2, abs=1e-4 * size)
        moment = turned["torque_nm"] - np.cross(pose[:3], turned["force_n"])
        assert felt["torque_nm"] == pytest.approx((one["torque_nm"] - moment) / 2, abs=1e-5 * size)
        assert felt["penetration_m"] == pytest.approx(max(one["penetration_m"], other["penetration_m"]), abs=1e-8)
        contacts = both.contacts(pose)
        assert (contacts["part"] == 1).sum() == other["contacts"]
        assert contacts["force_n"].sum(axis=0) == pytest.approx(felt["force_n"], abs=1e-4 * size)
        touching += size > 1
        again = pickle.loads(pickle.dumps(both))
    assert touching > 20 and again.wrench(pose).tobytes() == both.wrench(pose).tobytes()


def test_a_query_takes_the_fields_and_points_of_scenes(block: vps.Voxmap) -> None:
    mesh, pose = box([0, 0, 0], [0.01, 0.01, 0.01]), poses_near_contact(300)
    shells = {points: vps.PointShell.bake(mesh, VOXEL_M, points=points) for points in ("facets", "voxels")}
    for_gradients = vps.Voxmap.bake(box([-0.02, -0.02, -0.01], [0.02, 0.02, 0.01]), VOXEL_M, field="surface-point")
    assert 2 * block.nbytes < for_gradients.nbytes < 3 * block.nbytes
    seen = set()
    for points, shell in shells.items():
        for field in ("trilinear", "layers", "octant", "surface-point"):
            query = vps.ContactQuery(for_gradients, shell, 2000.0, field)
            found = query.wrench(pose)
            again = pickle.loads(pickle.dumps(query))
            assert again.wrench(pose).tobytes() == found.tobytes(), (points, field)
            # Each looks up in its own way, and none is far from the others.
            seen.add(found.tobytes())
            plain = vps.ContactQuery(block, shell, 2000.0).wrench(pose)
            deep = plain["penetration_m"] > 2 * VOXEL_M
            assert np.abs(found["penetration_m"] - plain["penetration_m"])[deep].max() < VOXEL_M
    assert len(seen) == 8
    with pytest.raises(vps.InvalidInput, match="bake them for this field"):
        vps.ContactQuery(block, shells["facets"], field="surface-point")
    with pytest.raises(vps.InvalidInput, match='field is "nonsense": give "layers" or'):
        vps.ContactQuery(block, shells["facets"], field="nonsense")
    with pytest.raises(vps.InvalidInput, match='points is "": give "facets" or "voxels"'):
        vps.PointShell.bake(mesh, VOXEL_M, points="")


def test_an_error_is_said_and_kept(block: vps.Voxmap, cube: vps.PointShell, query: vps.ContactQuery) -> None:
    edge_m, unseen_m = block.accuracy["surface_error_m"], cube.accuracy["unseen_depth_m"]
    assert edge_m is not None and unseen_m is not None
    error_m = edge_m + unseen_m + 0.1 * VOXEL_M
    assert query.error_m == pytest.approx(error_m, rel=1e-6)
    # Upright on its corner the cube presses with the volume that is immersed.
    half_turn = np.arccos(1 / np.sqrt(3)) / 2
    turned = [np.sin(half_turn) / np.sqrt(2), -np.sin(half_turn) / np.sqrt(2), 0, np.cos(half_turn)]
    for depth_m in (2e-4, 5e-4, 8e-4):
        found = query.wrench([0, 0, 0.01 - depth_m, *turned])
        force_n = 2000 / VOXEL_M**2 * depth_m**3 * np.sqrt(3) / 2
        assert abs(found["penetration_m"] - depth_m) < error_m
        assert abs(found["force_n"][2] / force_n - 1) < error_m / depth_m
        assert found["force_n"][2] == pytest.approx(force_n, rel=0.1)
    assert vps.ContactQuery(block, cube, field="layers").error_m is None


def test_patches_nearest_point_and_first_contact(block: vps.Voxmap, query: vps.ContactQuery) -> None:
    above, inside = [0.001, 0.002, 0.012, *IDENTITY], [0.001, 0.002, 0.0098, *IDENTITY]
    nearest = query.nearest(above)
    assert nearest.dtype == vps.NEAREST_DTYPE and nearest["part"] == 0
    assert nearest["distance_m"] == query.wrench(above)["clearance_m"] == pytest.approx(0.002, abs=2e-5)
    assert nearest["on_part_m"] == pytest.approx(nearest["on_shell_m"] - [0, 0, 0.002], abs=2e-5)
    assert query.nearest(inside) is None and query.nearest([0, 0, 1, *IDENTITY]) is None
    patches = query.patches(inside)
    assert patches.dtype == vps.PATCH_DTYPE and len(patches) == 1 and len(query.patches(above)) == 0
    assert patches["force_n"][0] == pytest.approx(query.wrench(inside)["force_n"], rel=1e-4, abs=1e-6)
    assert patches["position_m"][0] == pytest.approx([0.006, 0.007, 0.0098], abs=1e-4)
    assert patches["area_m2"][0] == pytest.approx(1e-4, rel=0.1)
    touched = query.first_contact(above, inside, 1e-6)
    assert touched is not None
    share, pose = touched
    assert share == pytest.approx(2.0 / 2.2, abs=1e-3) and query.wrench(pose)["contacts"] > 0
    assert query.first_contact(above, [0.001, 0.002, 0.1, *IDENTITY]) is None
    with pytest.raises(vps.InvalidInput, match="tolerance_m is 0"):
        query.first_contact(above, inside, 0)


def test_stiffness_is_how_the_wrench_changes(query: vps.ContactQuery) -> None:
    pose = np.array([0.001, 0.002, 0.0098, *IDENTITY])
    found = query.stiffness(pose)
    assert found.shape == (6, 6) and (found == found.T).all()
    for axis in range(3):
        step = 1e-6 * np.eye(7)[axis]
        more, less = query.wrench(pose + step), query.wrench(pose - step)
        change = np.hstack([more["force_n"] - less["force_n"], more["torque_nm"] - less["torque_nm"]]) / -2e-6
        # Stiffness times 441 points that stand for the face.
        assert found[axis] == pytest.approx(change, abs=1e-3 * 2000 * 441)
    assert (query.stiffness([0, 0, 1, *IDENTITY]) == 0).all()
    with pytest.raises(vps.InvalidInput, match="2 poses: give one"):
        query.stiffness([pose, pose])


def test_few_points_give_the_bits_of_many(block: vps.Voxmap) -> None:
    points = np.random.default_rng(5).uniform(-0.03, 0.03, (5000, 3))
    distances, gradients = block.distance(points)
    few, slopes = block.distance(points[:100])
    assert (few == distances[:100]).all() and (slopes == gradients[:100]).all()


def test_distances_to_a_box(block: vps.Voxmap) -> None:
    random = np.random.default_rng(1)
    # Over the upper face, away from its edges.
    points = random.uniform([-0.01, -0.01, 0.0075], [0.01, 0.01, 0.0125], (10_000, 3))
    distances, gradients = block.distance(points)
    assert distances.shape == (10_000,) and gradients.shape == (10_000, 3)
    assert distances == pytest.approx(points[:, 2] - 0.01, abs=1e-6)
    assert gradients == pytest.approx(np.tile([0, 0, 1.0], (10_000, 1)), abs=1e-3)
    one, gradient = block.distance(points[3])
    assert isinstance(one, float) and one == distances[3] and (gradient == gradients[3]).all()
    far, gradient = block.distance([1, 1, 1])
    assert far == block.band_m and not gradient.any()


def test_nothing_to_ask_is_no_error(query: vps.ContactQuery, block: vps.Voxmap) -> None:
    assert query.wrench(np.empty((0, 7))).shape == (0,)
    distances, gradients = block.distance(np.empty((0, 3)))
    assert distances.shape == (0,) and gradients.shape == (0, 3)


def test_float32_and_lists_are_taken() -> None:
    mesh = box([0, 0, 0], [0.01, 0.01, 0.01])
    same = vps.Mesh(mesh.vertices.astype(np.float32), mesh.faces.astype(np.int16).tolist())
    assert (same.faces == mesh.faces).all() and same.vertices == pytest.approx(mesh.vertices, abs=1e-9)
    assert mesh.volume_m3 == pytest.approx(1e-6) and mesh.center_of_mass_m == pytest.approx([0.005] * 3)
    assert mesh.warnings == []


def child(query: vps.ContactQuery, poses: NDArray[np.float64], bits: bytes) -> None:
    assert query.wrench(poses).tobytes() == bits


def test_a_forked_process_has_threads_of_its_own(query: vps.ContactQuery) -> None:
    poses = poses_near_contact(1000)
    bits = query.wrench(poses).tobytes()
    process = multiprocessing.get_context("fork").Process(target=child, args=(query, poses, bits))
    process.start()
    process.join(300)
    hangs = process.is_alive()
    process.kill()
    process.join()
    assert not hangs and process.exitcode == 0
