"""What every adapter does: reads meshes and poses, times its queries, writes wrenches as CSV and a line of JSON."""

import json
import resource
import sys
import time

import numpy as np

# Processor time for the poses of one scene, s.
LONGEST_S = 300.0


def mesh(path):
    """Vertices (n, 3) in metres and triangles (m, 3) of an OBJ file of triangles."""
    vertices, triangles = [], []
    with open(path) as lines:
        for fields in (line.split() for line in lines):
            if fields and fields[0] == "v":
                vertices.append([float(value) for value in fields[1:4]])
            elif fields and fields[0] == "f":
                triangles.append([int(corner.split("/")[0]) - 1 for corner in fields[1:4]])
    return np.array(vertices), np.array(triangles)


def faces(vertices, triangles):
    """Of triangles with an area: outward unit normals (m, 3), distances of their planes from the origin (m,), areas (m,)."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    there = lengths > 1e-14
    normals = normals[there] / lengths[there, None]
    return normals, np.einsum("ij,ij->i", normals, a[there]), 0.5 * lengths[there]


def is_convex(vertices, triangles):
    """Whether no vertex is more than 2 micrometres above a face; every so many faces are looked at."""
    normals, heights, _ = faces(vertices, triangles)
    step = max(1, len(normals) // 500)
    return bool(np.all(normals[::step] @ vertices.T <= heights[::step, None] + 2e-6))


def main(prepare):
    """Runs `ADAPTER SCENE_FOLDER POSES.csv WRENCHES.csv`.

    prepare(folder) gives settings in words, ask and read. ask(position (3,), quaternion x y z w (4,)) is one query,
    and all that is timed, in processor time;
    read(position) then gives force (3,) and torque (3,) on the tool about its origin, world axes, in any one unit of force; it is None where an
    answer is less than a wrench.
    """
    folder, poses, out = sys.argv[1:]
    imported_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began = time.process_time()
    settings, ask, read = prepare(folder)
    bake_s = time.process_time() - began
    memory_mb = 1.024e-3 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - imported_kb)
    n_poses, total_ns = 0, 0
    with open(out, "w") as file:
        file.write("t_s,fx_n,fy_n,fz_n,tx_nm,ty_nm,tz_nm,query_ns\n" if read else "t_s,query_ns\n")
        for t, *pose in np.loadtxt(poses, delimiter=",", skiprows=1):
            position, quaternion = np.array(pose[:3]), np.array(pose[3:]) / np.linalg.norm(pose[3:])
            began = time.process_time_ns()
            ask(position, quaternion)
            took = time.process_time_ns() - began
            n_poses, total_ns = n_poses + 1, total_ns + took
            if total_ns > 1e9 * LONGEST_S:
                raise SystemExit(f"stopped after {n_poses} poses, {1e-6 * total_ns / n_poses:.0f} ms each: the scene has {LONGEST_S:.0f} s")
            wrench = np.concatenate(read(position)) if read else ()
            file.write(",".join(f"{value:.9g}" for value in (t, *wrench, took)) + "\n")
    print(json.dumps({"bake_s": bake_s, "memory_mb": memory_mb, "settings": settings}))
