"""Two parts that every test may ask: a block of 40 x 40 x 20 mm around the origin, and a cube of 10 mm whose mesh frame is at a corner."""

from pathlib import Path

import hapticd_vps as vps
import numpy as np
import pytest

ROOT = Path(__file__).parents[3]
VOXEL_M = 5e-4


def box(low: list[float], high: list[float]) -> vps.Mesh:
    """A box between two corners, m."""
    corners = np.array([low, high])
    vertices = [[corners[i, 0], corners[j, 1], corners[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    return vps.Mesh(vertices, faces)


BLOCK = box([-0.02, -0.02, -0.01], [0.02, 0.02, 0.01])
CUBE = box([0, 0, 0], [0.01, 0.01, 0.01])


@pytest.fixture(scope="session")
def block() -> vps.Voxmap:
    return vps.Voxmap.bake(BLOCK, VOXEL_M)


@pytest.fixture(scope="session")
def cube() -> vps.PointShell:
    return vps.PointShell.bake(CUBE, VOXEL_M)


@pytest.fixture(scope="session")
def query(block: vps.Voxmap, cube: vps.PointShell) -> vps.ContactQuery:
    return vps.ContactQuery(block, cube, stiffness_n_per_m=2000.0)
