"""Coal: every contact of a convex tool, or of a mesh, with the triangles of the part; depth times area pushes along the normal."""

from importlib.metadata import version

import coal
import eigenpy
import numpy as np
import wrench_csv

# Longest edge of the part's triangles, m: what a triangle presses with is its whole area times its depth.
LONGEST = 1e-3


def refined(vertices, triangles):
    """Triangles cut across their longest edges until none is longer than LONGEST: corners (m, 3, 3)."""
    done, corners = [], vertices[triangles]
    while len(corners):
        edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        longest = edges.argmax(axis=1)
        is_done = edges.max(axis=1) <= LONGEST
        done.append(corners[is_done])
        rest, longest = corners[~is_done], longest[~is_done]
        row = np.arange(len(rest))
        a, b, c = (rest[row, (longest + k) % 3] for k in range(3))
        middle = 0.5 * (a + b)
        corners = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    return np.concatenate(done)


def bounding_tree(corners):
    tree = coal.BVHModelOBBRSS()
    tree.beginModel(len(corners), 3 * len(corners))
    for a, b, c in corners:
        tree.addTriangle(a, b, c)
    tree.endModel()
    return tree


def prepare(folder):
    corners = refined(*wrench_csv.mesh(f"{folder}/part.obj"))
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    part = bounding_tree(corners)
    vertices, triangles = wrench_csv.mesh(f"{folder}/tool.obj")
    tool = bounding_tree(vertices[triangles])
    is_convex = wrench_csv.is_convex(vertices, triangles)
    if is_convex:
        tool.buildConvexHull(True, "Qt")
        tool = tool.convex
    request = coal.CollisionRequest(coal.CollisionRequestFlag.CONTACT, 1_000_000)
    request.gjk_initial_guess = coal.GJKInitialGuess.CachedGuess
    result, fixed = coal.CollisionResult(), coal.Transform3s.Identity()

    def ask(position, quaternion):
        result.clear()
        x, y, z, w = quaternion
        coal.collide(part, fixed, tool, coal.Transform3s(eigenpy.Quaternion(w, x, y, z).toRotationMatrix(), position), request, result)

    def read(position):
        contacts = result.getContacts()
        if not len(contacts):
            return np.zeros(3), np.zeros(3)
        of_part = np.array([contact.b1 for contact in contacts])
        # Several triangles of the tool may touch one of the part.
        shares = areas[of_part] / np.bincount(of_part)[of_part]
        pushes = np.array([contact.normal * abs(contact.penetration_depth) for contact in contacts]) * shares[:, None]
        arms = np.array([contact.pos for contact in contacts]) - position
        return pushes.sum(axis=0), np.cross(arms, pushes).sum(axis=0)

    kind = "convex hull" if is_convex else "mesh"
    settings = (
        f"Coal {version('coal')}: {kind} of the tool against a tree of OBB-RSS over the part, cut to edges of at most {1e3 * LONGEST:g} mm; "
        "every contact pushes with depth × area of its triangle"
    )
    return settings, ask, read


wrench_csv.main(prepare)
