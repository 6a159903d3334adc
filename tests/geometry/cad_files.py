"""Files as CAD programs and mesh libraries write them, made by OpenCASCADE, gmsh and Manifold, with the volume that these kernels themselves give."""

from typing import NamedTuple

import cadquery
import gmsh
import manifold3d
import numpy as np
import trimesh

# Of a chord to its arc, mm and rad: balls lose two thousandths of their volume.
CHORD_MM = 0.01
CHORD_RAD = 0.1


class CadFile(NamedTuple):
    """A file in millimetres, and what is in it."""

    path: object
    volume_mm3: float
    bodies: int = 1
    cavities: int = 0
    open_pieces: int = 0


def box(edges, middle=(0, 0, 0)):
    return cadquery.Workplane().box(*edges).translate(middle)


def rod(radius, height, middle=(0, 0, 0)):
    return cadquery.Workplane().circle(radius).extrude(height).translate(middle)


def open_cascade_parts():
    """Name, and the solids that stand in the file as they are."""
    hollow = box([40, 40, 40]).cut(box([30, 30, 30]))
    screw = rod(3, 20).union(rod(5, 4, (0, 0, 20)))
    plate = box([30, 30, 8], (0, 0, 6)).cut(rod(3, 20))
    nut = cadquery.Workplane().polygon(6, 20).circle(5).extrude(8)
    ball = cadquery.Workplane().sphere(10)
    return [
        ("one", [box([20, 30, 10])]),
        ("touching", [box([40, 40, 10]), box([20, 20, 10], (0, 0, 10))]),
        ("overlapping", [box([40, 40, 10]), box([20, 20, 10], (0, 0, 7))]),
        ("nested", [box([40, 40, 10]), box([6, 6, 5])]),
        ("hollow", [hollow]),
        ("in-hollow", [hollow, box([10, 10, 10])]),
        ("screw-in-bore", [screw, plate]),
        ("bolt-and-nut", [nut, rod(5, 30)]),
        ("two-balls", [ball, ball.translate((12, 0, 0))]),
        ("thin-tube", [cadquery.Workplane().circle(10).circle(9.4).extrude(30)]),
    ]


def by_open_cascade(folder):
    """STL and 3MF of cadquery, and STEP that gmsh meshes."""
    for name, parts in open_cascade_parts():
        solids = [solid for part in parts for solid in part.solids().vals()]
        whole = solids[0] if len(solids) == 1 else solids[0].fuse(*solids[1:])
        n_shells = sum(len(solid.Shells()) for solid in solids)
        counts = {"volume_mm3": whole.Volume(), "bodies": len(solids), "cavities": n_shells - len(solids)}
        compound = cadquery.Compound.makeCompound(solids)
        for kind in ("stl", "3mf"):
            path = folder / f"{name}.{kind}"
            cadquery.exporters.export(cadquery.Workplane(obj=compound), str(path), tolerance=CHORD_MM, angularTolerance=CHORD_RAD)
            yield CadFile(path, **counts)
        step = folder / f"{name}.step"
        cadquery.exporters.export(cadquery.Workplane(obj=compound), str(step))
        gmsh.initialize()
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 2.0)
        # Triangles on each turn of a round face.
        gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 64)
        gmsh.open(str(step))
        gmsh.model.mesh.generate(2)
        path = folder / f"{name}-gmsh.stl"
        gmsh.write(str(path))
        gmsh.finalize()
        yield CadFile(path, **counts)


def triangles(manifold):
    mesh = manifold.to_mesh()
    return trimesh.Trimesh(mesh.vert_properties[:, :3], mesh.tri_verts, process=False)


def by_manifold(folder):
    """Bodies of Manifold in one file without a Boolean, as slicers and mesh libraries have them; the volume is that of its union."""

    def cube(edges, middle=(0, 0, 0)):
        return manifold3d.Manifold.cube(edges, True).translate(middle)

    def union(parts):
        return manifold3d.Manifold.batch_boolean(parts, manifold3d.OpType.Add)

    def written(name, meshes, kind="stl", **counts):
        path = folder / f"{name}.{kind}"
        trimesh.util.concatenate(meshes).export(path)
        return CadFile(path, **counts)

    ball_in_block = cube([30, 30, 30]) - manifold3d.Manifold.sphere(12, 128)
    for kind in ("stl", "ply", "obj"):
        yield written("ball-cavity", [triangles(ball_in_block)], kind, volume_mm3=ball_in_block.volume(), cavities=1)
    voxels = [cube([5, 5, 5], (5 * i, 5 * j, 5 * k)) for i in range(4) for j in range(4) for k in range(4)]
    yield written("voxels", [triangles(voxel) for voxel in voxels], volume_mm3=union(voxels).volume(), bodies=64)
    rods = [manifold3d.Manifold.cylinder(30, 2, 2, 64, True).rotate((0, turn, 7 * turn)) for turn in range(0, 180, 26)]
    yield written("rods", [triangles(rod) for rod in rods], volume_mm3=union(rods).volume(), bodies=len(rods))
    random = np.random.default_rng(1)
    boxes = [cube(random.uniform(2, 8, 3)).rotate(random.uniform(0, 360, 3)).translate(random.uniform(-10, 10, 3)) for _ in range(60)]
    yield written("sixty-boxes", [triangles(one) for one in boxes], volume_mm3=union(boxes).volume(), bodies=60)
    block = cube([20, 20, 10])
    inverted = triangles(cube([10, 10, 10], (30, 0, 0)))
    inverted.invert()
    yield written("one-inverted", [triangles(block), inverted], volume_mm3=block.volume() + 1000, bodies=2)
    # A repeat of all triangles is the part itself.
    yield written("thrice", [triangles(block)] * 3, volume_mm3=block.volume())
    sheet = trimesh.Trimesh([[0, 0, 8], [6, 0, 8], [6, 6, 8], [0, 6, 8]], [[0, 1, 2], [0, 2, 3]], process=False)
    yield written("with-sheet", [triangles(block), sheet], volume_mm3=block.volume(), open_pieces=1)


def all_files(folder):
    folder.mkdir(parents=True, exist_ok=True)
    yield from by_open_cascade(folder)
    yield from by_manifold(folder)
