"""Voxmap-pointshell contact: two triangle meshes in, the contact wrench of a pose out.

SI units; a pose is that of the shell's mesh frame in the world: the voxmap's mesh frame, or that of several parts. `help(hapticd_vps)` has shapes, frames, errors and cost of each call.
"""

from collections.abc import Callable, Iterable
from os import PathLike
from typing import Any, Final, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["ContactQuery", "FileError", "InvalidInput", "Mesh", "PointShell", "Voxmap", "CONTACT_DTYPE", "NEAREST_DTYPE", "PATCH_DTYPE", "WRENCH_DTYPE", "__version__"]
__version__: str

CONTACT_DTYPE: np.dtype[np.void]
"""`position_m` (3,), `normal` (3,), `gradient` (3,), `force_n` (3,), `depth_m`, `area_m2`, `part`, `point`."""
NEAREST_DTYPE: np.dtype[np.void]
"""`on_shell_m` (3,), `on_part_m` (3,), `distance_m`, `part`, `point`."""
PATCH_DTYPE: np.dtype[np.void]
"""`normal` (3,), `force_n` (3,), `position_m` (3,), `area_m2`, `depth_m`, `part`, `contacts`."""
WRENCH_DTYPE: np.dtype[np.void]
"""`force_n` (3,), `torque_nm` (3,), `penetration_m`, `clearance_m`, `contacts`."""

class InvalidInput(ValueError): ...
class FileError(OSError): ...

@final
class Mesh:
    def __new__(cls, vertices: ArrayLike, faces: ArrayLike) -> Mesh: ...
    @staticmethod
    def load(path: str | PathLike[str], metres_per_unit: float) -> Mesh: ...
    @property
    def vertices(self) -> NDArray[np.float64]: ...
    @property
    def faces(self) -> NDArray[np.uint32]: ...
    @property
    def volume_m3(self) -> float: ...
    @property
    def center_of_mass_m(self) -> NDArray[np.float64]: ...
    @property
    def n_pieces(self) -> int: ...
    @property
    def n_bodies(self) -> int: ...
    @property
    def cavities_m3(self) -> list[float]: ...
    @property
    def n_open_pieces(self) -> int: ...
    @property
    def warnings(self) -> list[str]: ...

@final
class Voxmap:
    FAR_OUTSIDE: Final[int]
    DEEP_INSIDE: Final[int]
    @staticmethod
    def bake(
        mesh: Mesh, voxel_size_m: float, *, layers: int = 8, field: str = "trilinear", progress: Callable[[str, float], object] | None = None
    ) -> Voxmap: ...
    @staticmethod
    def load(path: str | PathLike[str]) -> Voxmap: ...
    def save(self, path: str | PathLike[str]) -> None: ...
    def distance(self, points: ArrayLike) -> tuple[Any, NDArray[np.float64]]: ...
    @property
    def voxel_size_m(self) -> float: ...
    @property
    def band_m(self) -> float: ...
    @property
    def origin_m(self) -> NDArray[np.float64]: ...
    @property
    def brick_index(self) -> NDArray[np.uint32]: ...
    @property
    def bricks(self) -> NDArray[np.float32]: ...
    @property
    def accuracy(self) -> dict[str, float | None]: ...
    @property
    def warnings(self) -> list[str]: ...
    @property
    def nbytes(self) -> int: ...

@final
class PointShell:
    @staticmethod
    def bake(
        mesh: Mesh, voxel_size_m: float, *, layers: int = 8, points: str = "facets", progress: Callable[[str, float], object] | None = None
    ) -> PointShell: ...
    @staticmethod
    def load(path: str | PathLike[str]) -> PointShell: ...
    def save(self, path: str | PathLike[str]) -> None: ...
    def __len__(self) -> int: ...
    @property
    def positions_m(self) -> NDArray[np.float32]: ...
    @property
    def normals(self) -> NDArray[np.float32]: ...
    @property
    def half_axes_m(self) -> NDArray[np.float32]: ...
    @property
    def weights(self) -> NDArray[np.float32]: ...
    @property
    def center_of_mass_m(self) -> NDArray[np.float64]: ...
    @property
    def voxel_size_m(self) -> float: ...
    @property
    def accuracy(self) -> dict[str, float | None]: ...
    @property
    def warnings(self) -> list[str]: ...
    @property
    def nbytes(self) -> int: ...

@final
class ContactQuery:
    def __new__(
        cls, voxmap: Voxmap | Iterable[tuple[Voxmap, ArrayLike]], shell: PointShell, stiffness_n_per_m: float = 1000.0, field: str = "trilinear"
    ) -> ContactQuery: ...
    @staticmethod
    def both_ways(
        fixed: tuple[Voxmap, PointShell], moving: tuple[Voxmap, PointShell], stiffness_n_per_m: float = 1000.0, field: str = "trilinear"
    ) -> ContactQuery:
        """Half of the energy of each part's points in the other one."""
    def wrench(self, poses: ArrayLike) -> Any:
        """One record of `WRENCH_DTYPE` for one pose, else an array (n,) of it."""
    def contacts(self, pose: ArrayLike) -> NDArray[np.void]:
        """An array of `CONTACT_DTYPE`."""
    def stiffness(self, pose: ArrayLike) -> NDArray[np.float64]:
        """(6, 6): the second derivative of the contact's energy."""
    def patches(self, pose: ArrayLike) -> NDArray[np.void]:
        """An array of `PATCH_DTYPE`, the hardest first."""
    def nearest(self, pose: ArrayLike) -> Any:
        """A record of `NEAREST_DTYPE`, or None."""
    def first_contact(self, from_pose: ArrayLike, to_pose: ArrayLike, tolerance_m: float = 1e-5) -> tuple[float, NDArray[np.float64]] | None:
        """The share of the motion that ends where it first touches, and the pose (7,) there."""
