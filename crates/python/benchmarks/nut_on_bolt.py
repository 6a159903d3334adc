"""100,000 poses of a nut on its bolt, beside Coal, MuJoCo and Drake on the same poses and machine.

    pip install ./crates/python coal==3.0.3 mujoco==4.0.0 drake==1.51.1 tetgen trimesh
    python crates/python/benchmarks/nut_on_bolt.py [POSES]

The M16 nut of config/models (8,244 triangles) is turned up and down the thread of its bolt (18,036 triangles), 0.15 mm out of place along the axis and
0.1 mm across at most, and tilted by 0.3 degrees at most: most poses touch. A peer that is not installed is left out; each is asked a sample of the poses,
one after the other, through its own Python package. Times are processor time for each pose, which other work on the machine changes little; of ours on
all processors also the time by the clock.
"""

import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import hapticd_vps as vps
import numpy as np
from numpy.typing import NDArray

MODELS = Path(__file__).parents[3] / "config/models"
BOLT, NUT = MODELS / "bolt-m16.stl", MODELS / "nut-m16.stl"
Array = NDArray[np.float64]
# A query at a pose x, y, z, qx, qy, qz, qw; gives the number of contacts that it found.
Ask = Callable[[Array], int]


def poses(n: int) -> Array:
    random = np.random.default_rng(24)
    turn = random.uniform(-np.pi, 3 * np.pi, n)
    tilt = np.radians(random.uniform(-0.3, 0.3, (n, 2)))
    half = 0.5 * turn
    out = np.zeros((n, 7))
    out[:, :2] = random.uniform(-1e-4, 1e-4, (n, 2))
    # A right-hand thread of 2 mm for each turn; at 34 mm the nut is in phase.
    out[:, 2] = 34e-3 + 2e-3 * turn / (2 * np.pi) + random.uniform(-1.5e-4, 1.5e-4, n)
    # The tilt about x and y after the turn about z, to first order in the tilt.
    out[:, 3] = 0.5 * (tilt[:, 0] * np.cos(half) + tilt[:, 1] * np.sin(half))
    out[:, 4] = 0.5 * (tilt[:, 1] * np.cos(half) - tilt[:, 0] * np.sin(half))
    out[:, 5], out[:, 6] = np.sin(half), np.cos(half)
    out[:, 3:] /= np.linalg.norm(out[:, 3:], axis=1, keepdims=True)
    return out


def rotation(pose: Array) -> Array:
    x, y, z, w = pose[3:]
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def coal_contacts() -> Iterator[tuple[str, int, Ask]]:
    import coal

    def tree(path: Path) -> Any:
        mesh = vps.Mesh.load(path, 1e-3)
        model = coal.BVHModelOBBRSS()
        model.beginModel(len(mesh.faces), len(mesh.vertices))
        model.addVertices(np.array(mesh.vertices))
        model.addTriangles(mesh.faces.astype(np.int64))
        model.endModel()
        return model

    bolt, nut = tree(BOLT), tree(NUT)
    fixed = coal.Transform3s.Identity()

    def collides(most: int) -> Ask:
        request = coal.CollisionRequest(coal.CollisionRequestFlag.CONTACT, most)

        def ask(pose: Array) -> int:
            result = coal.CollisionResult()
            coal.collide(bolt, fixed, nut, coal.Transform3s(rotation(pose), pose[:3]), request, result)
            return int(result.numContacts())

        return ask

    def is_at_none(pose: Array) -> int:
        result = coal.DistanceResult()
        away_m = coal.distance(bolt, fixed, nut, coal.Transform3s(rotation(pose), pose[:3]), coal.DistanceRequest(), result)
        return int(away_m <= 0)

    yield f"Coal {version('coal')}: OBB-RSS trees, all contacts of the triangles", 100, collides(1_000_000)
    yield f"Coal {version('coal')}: the first contact, which says that they touch", 1000, collides(1)
    yield f"Coal {version('coal')}: distance", 100, is_at_none


def mujoco_sdf() -> Iterator[tuple[str, int, Ask]]:
    import mujoco

    for points, iterations in ((40, 10), (200, 30)):
        model = mujoco.MjModel.from_xml_string(f"""<mujoco>
          <option gravity="0 0 0" sdf_initpoints="{points}" sdf_iterations="{iterations}"/>
          <asset><mesh name="bolt" file="{BOLT}" scale="1e-3 1e-3 1e-3"/><mesh name="nut" file="{NUT}" scale="1e-3 1e-3 1e-3"/></asset>
          <worldbody><geom type="sdf" mesh="bolt"/><body><freejoint/><geom type="sdf" mesh="nut" mass="0.06"/></body></worldbody>
        </mujoco>""")
        data = mujoco.MjData(model)

        def ask(pose: Array, model: Any = model, data: Any = data) -> int:
            data.qpos[:3], data.qpos[3:] = pose[:3], pose[[6, 3, 4, 5]]
            data.qvel[:] = 0
            mujoco.mj_forward(model, data)
            return int(data.ncon)

        yield f"MuJoCo {version('mujoco')}: mj_forward, SDF of both meshes, {points} points, {iterations} iterations", 1000, ask


def drake_hydroelastic() -> Iterator[tuple[str, int, Ask]]:
    import tetgen
    import trimesh
    from pydrake.common.eigen_geometry import Quaternion
    from pydrake.geometry import (
        AddCompliantHydroelasticProperties,
        AddRigidHydroelasticProperties,
        HydroelasticContactRepresentation,
        Mesh,
        MeshSource,
        ProximityProperties,
        RefineVolumeMeshIntoVtkFileContents,
    )
    from pydrake.math import RigidTransform
    from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
    from pydrake.multibody.tree import SpatialInertia
    from pydrake.systems.framework import DiagramBuilder

    folder = Path(tempfile.mkdtemp())
    bolt, nut = (trimesh.load(path, force="mesh").apply_scale(1e-3) for path in (BOLT, NUT))
    bolt.export(folder / "bolt.obj")
    # Tetrahedra over the same surface; Drake then cuts those of which no vertex is inside, where the pressure would be 0 throughout.
    points, cells = tetgen.TetGen(np.asarray(nut.vertices), np.asarray(nut.faces, np.int32)).tetrahedralize(switches="pYQ")[:2]
    (folder / "coarse.vtk").write_text(
        "# vtk DataFile Version 3.0\nnut\nASCII\nDATASET UNSTRUCTURED_GRID\n"
        f"POINTS {len(points)} double\n" + "".join(f"{x:.12g} {y:.12g} {z:.12g}\n" for x, y, z in points)
        + f"CELLS {len(cells)} {5 * len(cells)}\n" + "".join("4 {} {} {} {}\n".format(*cell) for cell in cells)
        + f"CELL_TYPES {len(cells)}\n" + "10\n" * len(cells)
    )
    (folder / "nut.vtk").write_text(RefineVolumeMeshIntoVtkFileContents(MeshSource(folder / "coarse.vtk")))

    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    rigid, compliant = ProximityProperties(), ProximityProperties()
    AddRigidHydroelasticProperties(1.0, rigid)
    AddCompliantHydroelasticProperties(1.0, 1e9, compliant)
    for properties in (rigid, compliant):
        properties.AddProperty("material", "coulomb_friction", CoulombFriction(0.0, 0.0))
    body = plant.AddRigidBody("nut", SpatialInertia.SolidSphereWithMass(0.06, 0.01))
    plant.RegisterCollisionGeometry(body, RigidTransform(), Mesh(str(folder / "nut.vtk")), "nut", compliant)
    plant.RegisterCollisionGeometry(plant.world_body(), RigidTransform(), Mesh(str(folder / "bolt.obj")), "bolt", rigid)
    plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    of_plant, of_graph = plant.GetMyMutableContextFromRoot(context), scene_graph.GetMyContextFromRoot(context)

    def ask(pose: Array) -> int:
        x, y, z, w = pose[3:]
        plant.SetFreeBodyPose(of_plant, body, RigidTransform(Quaternion(w, x, y, z), pose[:3]))
        query = scene_graph.get_query_output_port().Eval(of_graph)
        return sum(surface.num_faces() for surface in query.ComputeContactSurfaces(HydroelasticContactRepresentation.kPolygon))

    yield f"Drake {version('drake')}: contact surface, compliant nut of {len(cells)} tetrahedra, rigid bolt", 100, ask


def measure(ask: Ask, sample: Array) -> tuple[float, NDArray[np.int64]]:
    """Processor time for each pose, s, and how many contacts each has."""
    ask(sample[0])
    began = time.process_time()
    found = [ask(pose) for pose in sample]
    return (time.process_time() - began) / len(sample), np.array(found)


def main() -> None:
    asked = poses(int(sys.argv[1]) if len(sys.argv) > 1 else 100_000)
    began = time.perf_counter()
    # Voxels as in config/scenes/nut-on-bolt.toml.
    shell = vps.PointShell.bake(vps.Mesh.load(NUT, 1e-3), 5e-4)
    query = vps.ContactQuery(vps.Voxmap.bake(vps.Mesh.load(BOLT, 1e-3), 2e-4), shell)
    print(f"baked in {time.perf_counter() - began:.2f} s")
    query.wrench(asked[:1000])
    began, began_cpu = time.perf_counter(), time.process_time()
    contacts = query.wrench(asked)["contacts"]
    wall, ours = (time.perf_counter() - began) / len(asked), (time.process_time() - began_cpu) / len(asked)

    def tell(name: str, time_s: float, found: NDArray[np.int64], more: str) -> None:
        what = f"{(found > 0).mean():4.0%} of {len(found):6} poses touch, median of {np.median(found):4.0f} contacts"
        print(f"{name:90} {1e6 * time_s:9.1f} us  {what}  {more}")

    tell(f"hapticd-vps {vps.__version__}: {len(shell)} points", ours, contacts, f"{1e6 * wall:.1f} us by the clock, all processors")
    for peer in (coal_contacts, mujoco_sdf, drake_hydroelastic):
        try:
            for name, n, ask in peer():
                theirs, found = measure(ask, asked[:n])
                agree = ((found > 0) == (contacts[:n] > 0)).mean()
                tell(name, theirs, found, f"{theirs / ours:.0f} times ours; {agree:.0%} agree on touching")
        except ModuleNotFoundError as missing:
            print(f"{peer.__name__}: left out: {missing}")


if __name__ == "__main__":
    main()
