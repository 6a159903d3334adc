"""Parts and tools as Coal has them."""

import coal
import eigenpy
import wrench_csv


def bounding_tree(corners):
    """Triangles (m, 3, 3) as a tree of OBB-RSS."""
    tree = coal.BVHModelOBBRSS()
    tree.beginModel(len(corners), 3 * len(corners))
    for a, b, c in corners:
        tree.addTriangle(a, b, c)
    tree.endModel()
    return tree


def part(folder):
    """The part of a scene, its triangles as they are."""
    vertices, triangles = wrench_csv.mesh(f"{folder}/part.obj")
    return bounding_tree(vertices[triangles])


def tool(folder):
    """The tool of a scene, as a convex hull where it is one, and which it is in words."""
    vertices, triangles = wrench_csv.mesh(f"{folder}/tool.obj")
    tree = bounding_tree(vertices[triangles])
    if not wrench_csv.is_convex(vertices, triangles):
        return tree, "mesh"
    tree.buildConvexHull(True, "Qt")
    return tree.convex, "convex hull"


def transform(position, quaternion):
    """Pose of position (3,) and quaternion x y z w (4,)."""
    x, y, z, w = quaternion
    return coal.Transform3s(eigenpy.Quaternion(w, x, y, z).toRotationMatrix(), position)
