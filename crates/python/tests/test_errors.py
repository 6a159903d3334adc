"""Input that cannot be used: an exception with a text that helps, never a panic. FUZZ_ROUNDS repeats what is random with other seeds."""

import os
import re
from pathlib import Path
from typing import Any, Callable

import hapticd_vps as vps
import numpy as np
import pytest
from conftest import box

VERTICES: Any = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
FACES: Any = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
IDENTITY = np.eye(4)


def changed(array: Any, place: Any, value: float) -> Any:
    array = np.array(array)
    array[place] = value
    return array


MESHES: list[tuple[Any, Any, str]] = [
    (np.zeros((4, 2)), FACES, r"vertices has the shape \[4, 2\]: give \(n, 3\)"),
    (VERTICES, [[0, 1]], r"faces has the shape \[1, 2\]: give \(m, 3\)"),
    (VERTICES, [[0.0, 1.0, 2.0]], "faces has the dtype float64: give whole numbers"),
    ([["a", "b", "c"]], FACES, "vertices has the dtype <U1: give real numbers"),
    (np.array(VERTICES) * 1j, FACES, "vertices has the dtype complex128: give real numbers"),
    (VERTICES, [[0, 1, -1]], "triangle 0 names vertex -1: count vertices from 0"),
    (VERTICES, [[0, 1, 2], [1, 2, 4]], "triangle 1 names vertex 4, there are 4"),
    (VERTICES, [[0, 1, 2**40]], f"triangle 0 names vertex {2**40}"),
    (changed(VERTICES, (2, 1), np.nan), FACES, "vertex 2 .*finite"),
    (changed(VERTICES, (3, 0), 1e300), FACES, "vertex 3 .*1e9 from the origin"),
    (VERTICES, [[0, 0, 1]], "none of the 1 triangles has an area"),
    (VERTICES, [], r"faces has the shape \[0\]"),
    ([], np.empty((0, 3), int), r"vertices has the shape \[0\]"),
    (np.empty((0, 3)), np.empty((0, 3), int), "none of the 0 triangles has an area"),
]


@pytest.mark.parametrize(("vertices", "faces", "text"), MESHES)
def test_meshes(vertices: Any, faces: Any, text: str) -> None:
    with pytest.raises(vps.InvalidInput, match=text) as raised:
        vps.Mesh(vertices, faces)
    assert isinstance(raised.value, ValueError)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"voxel_size_m": 0}, "voxel_size_m is 0: give"),
        ({"voxel_size_m": -1}, "voxel_size_m is -1: give"),
        ({"voxel_size_m": float("nan")}, "voxel_size_m is NaN: give"),
        ({"voxel_size_m": 1e-9}, "voxel"),
        ({"voxel_size_m": 0.1, "layers": 1}, "layers is 1: give"),
        ({"voxel_size_m": 0.1, "layers": -5}, "layers is -5: give"),
        ({"voxel_size_m": 0.1, "layers": 1000}, "layers is 1000: give"),
    ],
)
def test_bakes(arguments: dict[str, Any], text: str) -> None:
    for bake in (vps.Voxmap.bake, vps.PointShell.bake):
        with pytest.raises(vps.InvalidInput, match=text):
            bake(vps.Mesh(VERTICES, FACES), **arguments)


@pytest.mark.parametrize(
    ("pose", "text"),
    [
        ([0, 0, 0], r"the pose has the shape \[3\]"),
        (np.zeros((3, 3, 4)), r"the pose has the shape \[3, 3, 4\]"),
        (1.0, r"the pose has the shape \[\]"),
        ([np.nan, 0, 0, 0, 0, 0, 1], "pose 0: translation"),
        ([0, 0, 1e10, 0, 0, 0, 1], "pose 0: translation"),
        ([0, 0, 0, 0, 0, 0, 0], "pose 0: .*unit quaternion"),
        ([[0, 0, 0, 0, 0, 0, 1], [0, 0, 0, 0, 0, 0, 2]], "pose 1: .*unit quaternion"),
        (changed(np.tile([0, 0, 0, 0, 0, 0, 1.0], (9001, 1)), (9000, 5), np.inf), "pose 9000: "),
        (changed(IDENTITY, (3, 0), 1), "pose 0: the last row"),
        (changed(IDENTITY, (0, 0), -1), "pose 0: .*right-handed"),
        (changed(IDENTITY, (0, 0), 1.1), "pose 0: .*unit length"),
        (changed([IDENTITY, IDENTITY], (1, 2, 2), np.nan), "pose 1: .*no rotation"),
        (changed(IDENTITY, (1, 3), np.inf), "pose 0: translation"),
    ],
)
def test_poses(query: vps.ContactQuery, pose: Any, text: str) -> None:
    with pytest.raises(vps.InvalidInput, match=text):
        query.wrench(pose)


def test_other_values(query: vps.ContactQuery, block: vps.Voxmap, cube: vps.PointShell) -> None:
    with pytest.raises(vps.InvalidInput, match="2 poses: give one"):
        query.contacts([[0, 0, 0, 0, 0, 0, 1]] * 2)
    for stiffness in (-1, np.nan, np.inf):
        with pytest.raises(vps.InvalidInput, match="stiffness_n_per_m is"):
            vps.ContactQuery(block, cube, stiffness)
    with pytest.raises(vps.InvalidInput, match="point 1: .*finite"):
        block.distance(np.array([[0, 0, 0], [0, 0, np.inf]]))
    with pytest.raises(vps.InvalidInput, match=r"points has the shape \[2\]"):
        block.distance([0, 0])
    with pytest.raises(vps.InvalidInput, match="metres_per_unit is 0"):
        vps.Mesh.load("a.obj", 0)


# Of other programs: keys of scenes and flags of hapticd. Backticks are left for features and commands.
FOREIGN = re.compile(r"`(?!vps`|gltf`|threemf`)|--\w|\bscene|\bsides = |\bunits = ")


ROUNDS = range(int(os.environ.get("FUZZ_ROUNDS", "1")))
NUMBERS = [0, 1, -1, 7, 0.5, 1e-9, 1e9, -1e9, 1e30, 1e308, -1e308, 5e-324, float("nan"), float("inf"), -float("inf"), 2**31, 2**32, 2**63, 2**64, 2**80]
OBJECTS: list[Any] = [None, "x", b"x", [], {}, set(), object(), [[]], [None], "nan", 1j, range(3), True, np.zeros(3, "M8[s]"), np.array(["1"] * 7), lambda: 0]


def anything(random: np.random.Generator) -> Any:
    """An argument as a program with a mistake passes it."""
    kind = random.integers(6)
    if kind == 0:
        return NUMBERS[random.integers(len(NUMBERS))]
    if kind == 1:
        return OBJECTS[random.integers(len(OBJECTS))]
    shape = [(3,), (7,), (4, 4), (5, 3), (5, 7), (2, 4, 4), (0, 3), (0, 7), (), (1, 1, 1), (9, 3)][random.integers(11)]
    if kind == 2:
        return random.integers(-2, 9, shape).astype(["i1", "u1", "i4", "u8", "?"][random.integers(5)])
    array = random.normal(size=shape)
    if shape[-1:] == (7,):
        array[..., 3:] /= np.linalg.norm(array[..., 3:], axis=-1, keepdims=True)
    elif shape[-2:] == (4, 4):
        array[...] = np.eye(4)
    if kind == 3:
        return np.asarray(array, ["f2", "f4", ">f8", "c8", "O"][random.integers(5)])
    if kind == 4 and array.size:
        array.reshape(-1)[random.integers(array.size)] = float(NUMBERS[random.integers(len(NUMBERS))])
    return array if kind == 4 else array.T.copy().T


@pytest.mark.filterwarnings("ignore:Casting complex values")
@pytest.mark.parametrize("seed", ROUNDS)
def test_random_arguments_raise_what_is_announced(seed: int, query: vps.ContactQuery, block: vps.Voxmap, cube: vps.PointShell) -> None:
    random = np.random.default_rng(seed)
    mesh = box([0, 0, 0], [1, 1, 1])
    calls: list[tuple[int, Callable[..., Any]]] = [
        (2, vps.Mesh),
        (2, vps.Mesh.load),
        (2, lambda size, layers: vps.Voxmap.bake(mesh, size, layers=layers)),
        (2, lambda size, layers: vps.PointShell.bake(mesh, size, layers=layers)),
        (1, lambda progress: vps.Voxmap.bake(mesh, 0.5, progress=progress)),
        (1, query.wrench),
        (1, query.contacts),
        (1, block.distance),
        (3, vps.ContactQuery),
        (1, lambda stiffness: vps.ContactQuery(block, cube, stiffness)),
        (1, vps.Voxmap.load),
        (1, vps.PointShell.load),
    ]
    went_well = np.zeros(len(calls), int)
    for _ in range(4000):
        which = random.integers(len(calls))
        n, call = calls[which]
        try:
            call(*(anything(random) for _ in range(n)))
            went_well[which] += 1
        except (ValueError, TypeError, OSError, OverflowError) as error:
            assert str(error) and not (isinstance(error, vps.InvalidInput) and FOREIGN.search(str(error)))
    # Such arguments reach the work and not only the checks before it.
    assert (went_well[[5, 6, 7, 9]] > 0).all(), went_well


@pytest.mark.parametrize("seed", ROUNDS)
def test_random_files_raise_what_is_announced(seed: int, tmp_path: Path, block: vps.Voxmap, cube: vps.PointShell) -> None:
    random = np.random.default_rng(seed)
    cube.save(tmp_path / "cube")
    small = vps.Voxmap.bake(box([0, 0, 0], [1, 1, 1]), 0.3, layers=2)
    small.save(tmp_path / "small")
    text = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    facets = [random.normal(size=12).astype("f4").tobytes() + b"\0\0" for _ in range(2)]
    stl = b"\0" * 80 + np.uint32(2).tobytes() + b"".join(facets)
    ply = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
    ply += b"property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"

    def in_metres(path: Path) -> Any:
        return vps.Mesh.load(path, 1.0)

    seeds: dict[str, tuple[bytes, Callable[[Path], Any]]] = {
        "a.obj": (text, in_metres),
        "a.stl": (stl, in_metres),
        "a.ply": (ply, in_metres),
        "small": ((tmp_path / "small").read_bytes(), vps.Voxmap.load),
        "cube": ((tmp_path / "cube").read_bytes(), vps.PointShell.load),
    }
    refused = 0
    for name, (whole, load) in seeds.items():
        (tmp_path / name).write_bytes(whole)
        load(tmp_path / name)
        for turn in range(100):
            data = bytearray(whole) if turn % 3 else bytearray(random.bytes(int(random.integers(300))))
            if turn % 3 == 1:
                for place in random.integers(len(data), size=random.integers(1, 8)):
                    data[place] = random.integers(256)
            (tmp_path / name).write_bytes(data[: random.integers(len(data) + 1)] if turn % 3 == 2 else data)
            try:
                load(tmp_path / name)
            except (vps.InvalidInput, vps.FileError) as error:
                assert name in str(error)
                refused += 1
    assert refused > 250


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("seed", ROUNDS)
def test_any_triangles_can_be_baked_and_asked(seed: int) -> None:
    random = np.random.default_rng(seed)
    touched = 0
    said: list[str] = []
    for _ in range(40):
        n = int(random.integers(3, 30))
        vertices = random.normal(size=(n, 3)) * 10.0 ** random.integers(-2, 1, 3)
        # Open, turned either way, and through each other; some without an area.
        mesh = vps.Mesh(vertices, np.vstack([[0, 1, 2], random.integers(n, size=(random.integers(40), 3))]))
        voxel_size_m = float(np.ptp(mesh.vertices, axis=0).max() / random.integers(2, 30))
        layers = int(random.integers(2, 9))
        voxmap, shell = vps.Voxmap.bake(mesh, voxel_size_m, layers=layers), vps.PointShell.bake(mesh, voxel_size_m, layers=layers)
        poses = np.hstack([random.normal(size=(20, 3)), np.tile([0, 0, 0, 1.0], (20, 1))])
        said += mesh.warnings + voxmap.warnings + shell.warnings
        found = vps.ContactQuery(voxmap, shell).wrench(poses)
        distances, gradients = voxmap.distance(random.normal(size=(20, 3)))
        for numbers in (found["force_n"], found["torque_nm"], found["penetration_m"], found["clearance_m"], distances, gradients):
            assert np.isfinite(numbers).all()
        touched += np.count_nonzero(found["contacts"])
    assert touched > 0
    assert any("is the unit right?" in text for text in said)
    assert not [text for text in said if FOREIGN.search(text)]
