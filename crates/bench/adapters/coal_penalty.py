"""Coal: every contact of a convex tool, or of a mesh, with the triangles of the part; depth times area pushes along the normal."""

from importlib.metadata import version

import coal
import coal_models
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


def prepare(folder):
    corners = refined(*wrench_csv.mesh(f"{folder}/part.obj"))
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    part = coal_models.bounding_tree(corners)
    tool, kind = coal_models.tool(folder)
    request = coal.CollisionRequest(coal.CollisionRequestFlag.CONTACT, 1_000_000)
    request.gjk_initial_guess = coal.GJKInitialGuess.CachedGuess
    result, fixed = coal.CollisionResult(), coal.Transform3s.Identity()

    def ask(position, quaternion):
        result.clear()
        coal.collide(part, fixed, tool, coal_models.transform(position, quaternion), request, result)

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

    settings = (
        f"Coal {version('coal')}: {kind} of the tool against a tree of OBB-RSS over the part, cut to edges of at most {1e3 * LONGEST:g} mm; "
        "every contact pushes with depth × area of its triangle"
    )
    return settings, ask, read


wrench_csv.main(prepare)
