"""What a run says about itself besides its states: scene, parameters, events, files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hapticd.state import Pose, number


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number that may be changed while the run goes on. SI; its unit is in its name."""

    name: str
    """Such as `contact_stiffness_n_per_m`."""
    value: float
    """Where it is, or goes to."""
    least: float
    """Least value that is accepted."""
    most: float
    """Most that is accepted."""
    scene: float
    """The scene's own value."""

    @classmethod
    def from_json(cls, said: dict[str, Any]) -> Parameter:
        """Takes a parameter as the server writes it."""
        return cls(said["name"], *(number(said[key]) for key in ("value", "least", "most", "scene")))


@dataclass(frozen=True, slots=True, eq=False)
class SceneObject:
    """One part of a scene."""

    name: str
    """Its name in the scene file."""
    role: str
    """`static` or `tool`."""
    movable: bool
    """Whether `Client.place` moves it."""
    pose: Pose
    """Where it stands at the start, `world_from_object`."""
    mesh: str | None
    """Path of its mesh for display, for `Client.mesh`."""

    @classmethod
    def from_json(cls, said: dict[str, Any]) -> SceneObject:
        """Takes an object as the server writes it."""
        return cls(said["name"], said["role"], said["movable"], Pose.from_json(said["pose"]), said["mesh"])


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """The scene that is rendered."""

    scene_idx: int
    """Its number: 0 the first, one more with each that takes its place."""
    name: str
    """Its name."""
    file: str
    """Its file, as the run was given it."""
    objects: tuple[SceneObject, ...]
    """Fixed objects in the order of the scene, then the tool."""
    clay: bool
    """Whether there is some."""
    switching_to: str | None
    """Another scene that is on its way."""

    @classmethod
    def from_json(cls, said: dict[str, Any]) -> Scene:
        """Takes a scene as the server writes it."""
        objects = tuple(SceneObject.from_json(an_object) for an_object in said["objects"])
        return cls(said["scene_idx"], said["name"], said["file"], objects, said["clay"], said["switching_to"])


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened: `docs/reference/api.md`, section 7."""

    event: str
    """Such as `state`, `fault`, `scene`, `parameter`, `recording`, `clay`."""
    tick: int | None
    """Tick in which it happened, or the newest one that had come by then; None before the first."""
    time_ns: int | None
    """Time of that tick since the loop began, ns."""
    text: str
    """For people."""
    names: tuple[str, ...]
    """For programs: what it is about."""

    @classmethod
    def from_json(cls, said: dict[str, Any]) -> Event:
        """Takes an event as the server writes it."""
        return cls(said["event"], said["tick"], said["time_ns"], said["text"], tuple(said["names"]))


@dataclass(frozen=True, slots=True)
class ClientRecording:
    """A recording that a client began."""

    file: str
    """Where it is, on the machine of the run."""
    records: int
    """Ticks in it so far."""
    dropped: int
    """Ticks that are missing."""

    @classmethod
    def from_json(cls, said: dict[str, Any]) -> ClientRecording:
        """Takes a recording as the server writes it."""
        return cls(said["file"], said["records"], said["dropped"])


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles for display, at most 100,000."""

    vertices: NDArray[np.float32]
    """Rows x, y, z, m, in the object's own frame."""
    triangles: NDArray[np.uint32]
    """Rows of three vertices."""

    @classmethod
    def from_bytes(cls, data: bytes) -> Mesh:
        """Takes a mesh as the server sends it (`docs/reference/api.md`, section 9). Raises ValueError for anything else."""
        head = np.frombuffer(data, "<u4", 4) if len(data) >= 16 else np.zeros(4, np.uint32)
        n_vertices, n_indices = int(head[2]), int(head[3])
        if data[:4] != b"HMSH" or head[1] != 1 or len(data) != 16 + 12 * n_vertices + 4 * n_indices:
            raise ValueError("no mesh of version 1")
        vertices = np.frombuffer(data, "<f4", 3 * n_vertices, 16).reshape(-1, 3)
        return cls(vertices, np.frombuffer(data, "<u4", n_indices, 16 + 12 * n_vertices).reshape(-1, 3))
