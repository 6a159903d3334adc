"""Geometry beside outside programs: exact distances of libigl and Coal, volumes of CAD kernels, files of slicers.

    compare.py [SECTION...] --hapticd PROGRAM --models FOLDER --folder FOLDER

| section | shows |
|---|---|
| distances | every stored sample of a field is the exact distance of libigl, of all meshes in the folder of models; signs are those of winding numbers |
| sides | beyond the band, at all sides of the grid and off it, no distance and no clearance is above the exact one, nor below the band |
| clearances | a thousand poses of each of five pairs of parts that are apart: no contact; clearance beside the distance of Coal, and what it is off by |
| kernels | volume, bodies, hollows and open pieces of files that OpenCASCADE, gmsh and Manifold wrote, beside what these know of them |
| slicers | the same of files that PrusaSlicer and Slic3r wrote |

A line for each check: what was worst, and what is allowed. Ends with 1 if one failed. Needs the packages that .ci/compare names, and `hapticd_vps`.
"""

import argparse
import concurrent.futures
import functools
import json
import multiprocessing
import pathlib
import shutil
import subprocess
import sys
import time

import cad_files
import coal
import hapticd_vps as vps
import igl
import numpy as np

# What the documents promise of a distance, voxels.
EXACT_VOXELS = 1e-4
# Asked of a clearance, voxels.
CLEARANCE_VOXELS = 0.05
# Points that are so much nearer to each other than voxels, and poses of which is said what the points and what the field is off by.
FINER = 4
N_NEAREST = 100
VOLUME_SHARE = 5e-3
LAYERS = 8
# Voxels on the longest side of a mesh.
FINE = 64
COARSE = 32
# Nearer to the surface than this, voxels, a winding number is no judge of the side; nor is any of a part where one is so far from a whole number.
ON_SURFACE_VOXELS = 1e-3
CLEAR = 0.1
# Samples of which a winding number is asked: of long thin triangles it takes a third of a millisecond.
N_SIGNS = 20_000


WORKERS = concurrent.futures.ProcessPoolExecutor(mp_context=multiprocessing.get_context("forkserver"))


class Checks:
    """Says of each check what came out."""

    def __init__(self):
        self.n_failed = 0

    def tell(self, name, worst, bound, more=""):
        # Not a number is no pass.
        passed = bool(worst <= bound)
        self.n_failed += not passed
        print(f"{'ok' if passed else 'FAILED':7} {name}: worst {worst:.3g}, bound {bound:.3g}{'; ' if more else ''}{more}", flush=True)


def rounding_voxels(mesh, voxel_size_m):
    """What coordinates of 32 bits may move a grid, voxels."""
    return np.abs(mesh.vertices).max() * np.finfo(np.float32).eps / voxel_size_m


def longest_m(mesh):
    return np.ptp(mesh.vertices, axis=0).max()


def squared_m2(corners, faces, points):
    return igl.point_mesh_squared_distance(points, corners, faces)[0]


def exact_m(mesh, points):
    """Distance of each point to the triangles of a mesh, by libigl, on all processors: a call uses one."""
    parts = np.array_split(np.ascontiguousarray(points), max(1, len(points) // 5000))
    squared = WORKERS.map(functools.partial(squared_m2, np.array(mesh.vertices), mesh.faces.astype(np.int64)), parts)
    return np.sqrt(np.concatenate(list(squared)))


def windings(mesh, points):
    """How often the triangles of a mesh wind around each point, by libigl."""
    return igl.fast_winding_number(np.array(mesh.vertices), mesh.faces.astype(np.int64), np.ascontiguousarray(points))


def model_files(folder):
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in (".obj", ".stl"))


class Samples:
    """All cells of a grid: where they are, m, what is stored there, and whether."""

    def __init__(self, voxmap, layers):
        index = voxmap.brick_index
        self.size_m = voxmap.voxel_size_m
        # A field ends half a voxel before its last layer.
        band_m = np.float32(layers - 0.5) * np.float32(self.size_m)
        bricks = np.full((*index.shape, 8, 8, 8), -band_m, np.float32)
        bricks[index == voxmap.DEEP_INSIDE] = band_m
        is_stored = index < voxmap.DEEP_INSIDE
        bricks[is_stored] = voxmap.bricks[index[is_stored]][:, :8, :8, :8]
        cells = [8 * n for n in index.shape]
        depths_m = bricks.transpose(0, 3, 1, 4, 2, 5).reshape(cells)
        places = np.stack(np.meshgrid(*(np.arange(n) + 0.5 for n in cells), indexing="ij"), axis=-1)
        self.is_stored = is_stored.repeat(8, 0).repeat(8, 1).repeat(8, 2).ravel()
        self.depths_m = depths_m.ravel().astype(np.float64)
        self.points_m = (voxmap.origin_m + self.size_m * places).reshape(-1, 3)
        # The ninth samples of a brick are the first of the next.
        padded = np.pad(depths_m, ((0, 1),) * 3, constant_values=-band_m)
        windows = np.lib.stride_tricks.sliding_window_view(padded, (9, 9, 9))[::8, ::8, ::8]
        self.n_wrong_copies = np.count_nonzero(windows[is_stored] != voxmap.bricks[index[is_stored]])


def error_voxels(found_m, exact, band_m, size_m):
    """How far distances are above the exact ones, or below these and the band."""
    return np.maximum(found_m - exact, np.minimum(exact, band_m) - found_m) / size_m


def without_lids(program, path, voxel_size_m, folder):
    """Places and distances of the triangles of a file alone, as `bake --field-out` gives them."""
    out = folder / "distances.npy"
    command = [program, "bake", path, "--voxel-size-mm", f"{1e3 * voxel_size_m:.17g}", "--units", "m", "--layers", str(LAYERS)]
    command += ["--sides", "thin", "--cache", "off", "--field-out", out, "--json"]
    printed = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE).stdout)
    distances_m = np.load(out)
    places = np.argwhere(np.isfinite(distances_m))
    found = printed["objects"][0] if "objects" in printed else printed
    return np.array(found["origin_m"]) + voxel_size_m * (places + 0.5), np.abs(distances_m[tuple(places.T)]).astype(np.float64)


def distances(checks, options):
    random = np.random.default_rng(1)
    for path in model_files(options.models):
        mesh = vps.Mesh.load(path, 1.0)
        size_m = longest_m(mesh) / FINE
        voxmap = vps.Voxmap.bake(mesh, size_m, layers=LAYERS)
        samples = Samples(voxmap, LAYERS)
        allowed = EXACT_VOXELS + rounding_voxels(mesh, size_m)
        # All that is stored, and some of what is only marked.
        marked = np.flatnonzero(~samples.is_stored)
        looked_at = np.concatenate([np.flatnonzero(samples.is_stored), random.choice(marked, min(20_000, len(marked)), replace=False)])
        points = samples.points_m[looked_at]
        depths_m = samples.depths_m[looked_at]
        exact = exact_m(mesh, points)
        has_lids = any("lid close" in warning or "lids close" in warning for warning in voxmap.warnings)
        # Faces of one body that lie in another are no surface of the solid; it may be deeper than these say.
        has_faces_within = mesh.n_bodies > 0 and mesh.n_pieces > 1
        error = error_voxels(np.abs(depths_m), exact, voxmap.band_m, size_m)
        more = f"{len(points)} samples, {len(mesh.faces)} triangles"
        if has_lids:
            # A lid may be nearer than every triangle of the file.
            nearer = error > allowed
            error = (np.abs(depths_m) - exact) / size_m
            more += f", {nearer.mean():.1%} of them nearer to a lid"
        elif has_faces_within:
            deeper = (error > allowed) & (depths_m > 0)
            error[deeper] = (np.minimum(exact, voxmap.band_m) - depths_m)[deeper] / size_m
            more += f", {deeper.mean():.1%} of them deeper than faces within"
        checks.tell(f"distances {path.name}", error.max(), allowed, more)
        checks.tell(f"copies {path.name}", samples.n_wrong_copies, 0)
        if has_lids:
            found_at, found_m = without_lids(options.hapticd, path, size_m, options.folder)
            error = np.abs(found_m - exact_m(mesh, found_at)) / size_m
            checks.tell(f"distances without lids {path.name}", error.max(), allowed, f"{len(found_at)} samples")
        # Half of them beside the surface, where the nearest triangle decides and not the fill.
        apart = exact > ON_SURFACE_VOXELS * size_m
        is_near = exact < 0.7 * size_m
        halves = [random.permutation(np.flatnonzero(apart & which))[: N_SIGNS // 2] for which in (is_near, ~is_near)]
        some = np.concatenate(halves)
        n_turns = windings(mesh, points[some])
        if np.abs(n_turns - np.round(n_turns)).max() > CLEAR:
            # What is inside of a part with holes is a matter of definition.
            print(f"        signs {path.name}: left out, it has holes", flush=True)
            continue
        n_wrong = np.count_nonzero((n_turns > 0.5) != (depths_m[some] > 0))
        checks.tell(f"signs {path.name}", n_wrong, 0, f"{len(some)} samples")


def around_sides(mesh, voxmap, layers, n, random):
    """Points beside each of the six sides of a grid, on them, and up to three bands beyond, in equal parts.

    Sides are those of the bricks, which stick out of the box that was asked for, and those of that box: a layer more than asked for around the mesh.
    """
    size_m = voxmap.voxel_size_m
    pad_m = (layers + 1) * size_m
    low_m = voxmap.origin_m
    edges_m = 8 * size_m * np.array(voxmap.brick_index.shape)
    points = []
    for axis in range(3):
        bounds_m = mesh.vertices[:, axis].min() - pad_m, mesh.vertices[:, axis].max() + pad_m
        for outward, sides_m in ((-1, (low_m[axis], bounds_m[0])), (1, (low_m[axis] + edges_m[axis], bounds_m[1]))):
            for side_m in sides_m:
                for voxels in (random.uniform(-0.5, 0.5, n), np.zeros(n), random.uniform(0.5, 3 * layers, n)):
                    of_side = low_m + random.uniform(-0.1, 1.1, (n, 3)) * edges_m
                    of_side[:, axis] = side_m + outward * size_m * voxels
                    points.append(of_side)
    return np.concatenate(points)


def rotations(n, random):
    """Matrices [n, 3, 3] of rotations, evenly spread."""
    quaternions = random.normal(size=(n, 4))
    x, y, z, w = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)


def poses_of(turns, translations):
    poses = np.tile(np.eye(4), (len(turns), 1, 1))
    poses[:, :3, :3] = turns
    poses[:, :3, 3] = translations
    return poses


def shell_points(shell):
    return shell.positions_m.reshape(-1, 3)[: len(shell)].astype(np.float64) + shell.center_of_mass_m


def little_box(edge_m):
    corners = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)]) * edge_m
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    return vps.Mesh(corners, np.array(faces))


def sides(checks, options):
    random = np.random.default_rng(2)
    for name in ("rocker-arm.obj", "factory_bolt_m16_tight.obj", "featuretype.STL"):
        mesh = vps.Mesh.load(options.models / name, 1.0)
        size_m = longest_m(mesh) / COARSE
        tool = vps.PointShell.bake(little_box(0.4 * size_m), size_m)
        of_tool = shell_points(tool)
        for layers in (4, 10, 30, 60):
            voxmap = vps.Voxmap.bake(mesh, size_m, layers=layers)
            allowed = EXACT_VOXELS + rounding_voxels(mesh, size_m)
            points = around_sides(mesh, voxmap, layers, 500, random)
            exact = exact_m(mesh, points)
            error = error_voxels(voxmap.distance(points)[0], exact, voxmap.band_m, size_m)
            checks.tell(f"distance off {name}, {layers} layers", error.max(), allowed, f"{len(points)} points, nearest at {exact.min() / size_m:.2f} voxels")
            poses = poses_of(rotations(len(points), random), points)
            clearance_m = vps.ContactQuery(voxmap, tool).wrench(poses)["clearance_m"]
            of_poses = np.einsum("nij,pj->npi", poses[:, :3, :3], of_tool) + points[:, None]
            exact = exact_m(mesh, of_poses.reshape(-1, 3)).reshape(len(points), -1).min(axis=1)
            error = error_voxels(clearance_m, exact, voxmap.band_m, size_m)
            checks.tell(f"clearance off {name}, {layers} layers", error.max(), allowed, f"{len(points)} poses of {len(tool)} points")


def coal_tree(mesh):
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(mesh.faces), len(mesh.vertices))
    model.addVertices(np.array(mesh.vertices))
    model.addTriangles(mesh.faces.astype(np.int64))
    model.endModel()
    return model


class Pair:
    """An obstacle and a tool, each a file and metres for each of its units; `are_joined` where the files have them put together and apart."""

    # Poses beside the one of the files, in which these parts are put together: so far off, voxels, and turned so far, rad.
    ASIDE_VOXELS = 2.0
    TURNED = 0.03

    def __init__(self, options, obstacle, tool, are_joined):
        self.obstacle = vps.Mesh.load(options.models / obstacle[0], obstacle[1])
        self.tool = vps.Mesh.load(options.models / tool[0], tool[1])
        self.size_m = longest_m(self.obstacle) / FINE
        self.are_joined = are_joined
        # Of the poses that were asked for last.
        self.n_beside = 0
        self.of_obstacle = coal_tree(self.obstacle)
        self.of_tool = coal_tree(self.tool)
        self.voxmap = vps.Voxmap.bake(self.obstacle, self.size_m, layers=LAYERS)
        self.voxmap_of_tool = vps.Voxmap.bake(self.tool, self.size_m, layers=LAYERS)

    def distance_m(self, pose):
        """By Coal; 0 where triangles meet, which it finds sooner when it is asked for that alone."""
        here = coal.Transform3s.Identity()
        there = coal.Transform3s(pose[:3, :3], pose[:3, 3])
        if coal.collide(self.of_obstacle, here, self.of_tool, there, coal.CollisionRequest(), coal.CollisionResult()):
            return 0.0
        result = coal.DistanceResult()
        coal.distance(self.of_obstacle, here, self.of_tool, there, coal.DistanceRequest(), result)
        return result.min_distance

    def approached(self, random):
        """A pose at which the tool has come from afar to a random distance, within the band or just beyond."""
        wanted_m = random.uniform(0.0, 1.1) * self.voxmap.band_m
        turn = rotations(1, random)[0]
        middle = turn @ self.tool.vertices.mean(axis=0)
        direction = random.normal(size=3)
        direction /= np.linalg.norm(direction)
        aim = self.obstacle.vertices[random.integers(len(self.obstacle.vertices))]
        way_m = 2.0 * (longest_m(self.obstacle) + longest_m(self.tool))
        for _ in range(60):
            pose = poses_of([turn], [aim + way_m * direction - middle])[0]
            apart_m = self.distance_m(pose)
            # A step of what is too much never touches.
            if apart_m <= wanted_m + 0.02 * self.size_m:
                break
            way_m -= apart_m - wanted_m
        return pose, apart_m

    def beside(self, random):
        """A pose near that of the files, and the distance."""
        # Some so near that they pass through a gap of a hundredth of a voxel.
        share = random.random() ** 3
        # The turn of a small vector, made a rotation again.
        x, y, z = share * random.uniform(-self.TURNED, self.TURNED, 3)
        turn, _ = np.linalg.qr(np.array([[1, -z, y], [z, 1, -x], [-y, x, 1]]))
        turn *= np.sign(np.diag(turn))
        middle = self.tool.vertices.mean(axis=0)
        aside = share * random.uniform(-self.ASIDE_VOXELS, self.ASIDE_VOXELS, 3) * self.size_m
        pose = poses_of([turn], [middle - turn @ middle + aside])[0]
        return pose, self.distance_m(pose)

    def poses(self, n, random):
        """So many poses at which the parts do not touch, half of them near the joined one where there is one, and their distances by Coal, m."""
        found = []
        for _ in range(2 * n if self.are_joined else 0):
            pose, apart_m = self.beside(random)
            if apart_m > 0:
                found.append((pose, apart_m))
            if len(found) == n // 2:
                break
        if found:
            # Whole in the material is no touch for triangles.
            corners = np.array([pose[:3, :3] @ self.tool.vertices[0] + pose[:3, 3] for pose, _ in found])
            found = [item for item, n_turns in zip(found, windings(self.obstacle, corners)) if n_turns < 0.5]
        self.n_beside = len(found)
        while len(found) < n:
            pose, apart_m = self.approached(random)
            if apart_m > 0:
                found.append((pose, apart_m))
        return np.array([pose for pose, _ in found]), np.array([apart_m for _, apart_m in found])

    def nearest_points_m(self, shell, poses, clearances_m):
        """Exact distance of the nearest point of a shell at each pose: interpolation is off by less than the voxel that is looked at beyond the clearance."""
        of_shell = shell_points(shell)
        near = []
        for pose, clearance_m in zip(poses, clearances_m):
            points = of_shell @ pose[:3, :3].T + pose[:3, 3]
            near.append(points[self.voxmap.distance(points)[0] <= clearance_m + self.size_m])
        firsts = np.cumsum([0] + [len(points) for points in near[:-1]])
        return np.minimum.reduceat(exact_m(self.obstacle, np.concatenate(near)), firsts)


def spread(values):
    """Least, 5, 50 and 95 %, most."""
    at = np.quantile(values, [0.0, 0.05, 0.5, 0.95, 1.0])
    return " ".join(f"{value:+.3f}" for value in at)


def clearances(checks, options):
    pairs = {
        "round peg, hole": (("factory_round_hole_8mm_subdiv_3x.obj", 1.0), ("factory_round_peg_8mm_loose.obj", 1.0), True),
        "rectangular peg, hole": (("factory_rectangular_hole_8mm_subdiv_3x.obj", 1.0), ("factory_rectangular_peg_8mm_tight_subdiv_3x.obj", 1.0), True),
        "nut, bolt": (("factory_bolt_m16_tight.obj", 1.0), ("factory_nut_m16_tight_subdiv_3x.obj", 1.0), False),
        "gear, gear base": (("factory_gear_base_tight_space_5e-4_subdiv_4x.obj", 1.0), ("factory_gear_medium_space_5e-4.obj", 1.0), False),
        # Points of the bunny lie on the lids of its holes as well, of which Coal does not know.
        "bunny, rocker arm": (("rocker-arm.obj", 0.15), ("stanford-bunny.obj", 1.0), False),
    }
    for name, (obstacle, tool, are_joined) in pairs.items():
        random = np.random.default_rng(3)
        pair = Pair(options, obstacle, tool, are_joined)
        poses, apart_m = pair.poses(options.poses, random)
        known_m = np.minimum(apart_m, pair.voxmap.band_m)
        within = apart_m < pair.voxmap.band_m
        for finer in (1, FINER):
            shell = vps.PointShell.bake(pair.tool, pair.size_m / finer, layers=2)
            found = vps.ContactQuery(pair.voxmap, shell).wrench(poses)
            found_m = found["clearance_m"]
            off = (found_m - known_m) / pair.size_m
            if finer == 1:
                touches = found["contacts"] > 0
                checks.tell(f"no contact {name}", np.max(apart_m[touches], initial=0.0) / pair.size_m, CLEARANCE_VOXELS, f"{touches.sum()} poses touch")
                more = f"{np.mean(np.abs(off) <= CLEARANCE_VOXELS):.0%} of {len(poses)} poses within it, {within.sum()} within the band, "
                more += f"{pair.n_beside} put together; {len(shell)} points"
                checks.tell(f"clearance {name}", np.abs(off).max(), CLEARANCE_VOXELS, more)
            some = np.flatnonzero(within)[:: max(1, within.sum() // N_NEAREST)]
            nearest_m = pair.nearest_points_m(shell, poses[some], found_m[some])
            by_points = spread((nearest_m - apart_m[some]) / pair.size_m)
            by_field = spread((found_m[some] - nearest_m) / pair.size_m)
            # The points of the obstacle in the field of the tool see what lies between those of the tool.
            back = vps.PointShell.bake(pair.obstacle, pair.size_m / finer, layers=2)
            there_m = vps.ContactQuery(pair.voxmap_of_tool, back).wrench(np.linalg.inv(poses))["clearance_m"]
            both = spread((np.minimum(found_m, there_m) - known_m) / pair.size_m)
            print(f"        points {1 / finer:g} voxel apart, both ways: {both}", flush=True)
            print(f"        points {1 / finer:g} voxel apart: {spread(off)}; of {len(some)}, by points: {by_points}; by field: {by_field}", flush=True)


def tell_solid(checks, name, path, expected):
    mesh = vps.Mesh.load(path, 1e-3)
    volume_mm3 = 1e9 * mesh.volume_m3
    off = abs(volume_mm3 / expected.volume_mm3 - 1.0)
    checks.tell(f"volume {name}", off, VOLUME_SHARE, f"{volume_mm3:.1f} of {expected.volume_mm3:.1f} mm3")
    found = {"bodies": mesh.n_bodies, "cavities": len(mesh.cavities_m3), "open_pieces": mesh.n_open_pieces}
    wrong = [f"{n} {what}, {getattr(expected, what)} expected" for what, n in found.items() if n != getattr(expected, what)]
    checks.tell(f"pieces {name}", len(wrong), 0, "; ".join(wrong))


@functools.cache
def made_files(folder):
    return list(cad_files.all_files(folder))


def kernels(checks, options):
    for made in made_files(options.folder / "cad"):
        tell_solid(checks, made.path.name, made.path, made)


def slicers(checks, options):
    folder = options.folder / "sliced"
    folder.mkdir(parents=True, exist_ok=True)
    for of in made_files(options.folder / "cad"):
        if of.path.suffix != ".stl":
            continue
        name = of.path.stem
        if shutil.which("prusa-slicer"):
            for kind in ("stl", "obj", "3mf"):
                out = folder / f"{name}-prusa.{kind}"
                subprocess.run(["prusa-slicer", f"--export-{kind}", of.path, "--output", out], check=True, capture_output=True)
                tell_solid(checks, out.name, out, of)
        if shutil.which("slic3r"):
            copy = folder / of.path.name
            shutil.copy(of.path, copy)
            subprocess.run(["slic3r", "--repair", copy], check=True, capture_output=True)
            tell_solid(checks, f"{name} by slic3r", folder / f"{name}_fixed.obj", of)
    for slicer in ("prusa-slicer", "slic3r"):
        if not shutil.which(slicer):
            print(f"left out {slicer}: it is not installed")


SECTIONS = {"distances": distances, "sides": sides, "clearances": clearances, "kernels": kernels, "slicers": slicers}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=f"{', '.join(SECTIONS)}; all if none is named")
    parser.add_argument("--hapticd", type=pathlib.Path, required=True, help="the program")
    parser.add_argument("--models", type=pathlib.Path, required=True, help="folder with real meshes")
    parser.add_argument("--folder", type=pathlib.Path, required=True, help="for what is written")
    parser.add_argument("--poses", type=int, default=1000, help="of each pair, default 1000")
    options = parser.parse_args()
    unknown = set(options.sections) - set(SECTIONS)
    if unknown:
        parser.error(f"no such section: {', '.join(sorted(unknown))}")
    options.folder.mkdir(parents=True, exist_ok=True)
    checks = Checks()
    for name in options.sections or SECTIONS:
        began = time.perf_counter()
        SECTIONS[name](checks, options)
        print(f"        {name}: {time.perf_counter() - began:.0f} s", flush=True)
    WORKERS.shutdown()
    return 1 if checks.n_failed else 0


if __name__ == "__main__":
    sys.exit(main())
