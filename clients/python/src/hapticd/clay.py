"""What clients do to clay (`hapticd sculpt`): choose the craft, hold, take strokes back, save, and look at the samples. `docs/reference/api.md`, section 12."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from hapticd.connection import Connection, Every
from hapticd.errors import NoAnswer
from hapticd.state import Pose

PING_S = 0.25
"""A hold ends when its client has said nothing for a second."""
LOOK_S = 0.05
"""How often `wait_until` looks."""

Curves = Sequence[Sequence[Sequence[float]]] | Sequence[NDArray[np.float64]]
"""Rows x, y, z of each curve."""


def _listed(curves_m: Curves) -> list[list[list[float]]]:
    return [[[float(part) for part in place] for place in curve] for curve in curves_m]


FalloffAsked = str | Mapping[Literal["rate"], float] | Sequence[float]
"""A word, a rate `{"rate": f}`, or weights from the middle of the brush to its rim."""


def _falloff(asked: FalloffAsked) -> str | dict[str, float] | list[float]:
    if isinstance(asked, str):
        return asked
    if isinstance(asked, Mapping):
        return {str(key): float(value) for key, value in asked.items()}
    return [float(weight) for weight in asked]


@dataclass(frozen=True, slots=True, eq=False)
class ClayFacts:
    """How the piece and the tool stand."""

    version: int
    """Counts up with every change of the samples."""
    samples: int
    """How many there are."""
    spacing_m: float
    """How far neighbours are apart in the mean, m."""
    world_from_map: Pose
    """Where the piece stands: samples and region are in its map frame."""
    region_map: tuple[NDArray[np.float64], NDArray[np.float64]]
    """The part that deforms: least and largest corner, map frame, m."""
    craft: str
    """What the tool does."""
    crafts: tuple[str, ...]
    """All that it can do."""
    brush_m: float
    """Radius of the brush, m."""
    brush_range_m: tuple[float, float]
    """Least and most that `take` accepts, m."""
    falloff: str
    """`gaussian`, `constant`, `spherical`, `rate` or `table`."""
    color: str
    """Of paint, `#rrggbb` (sRGB)."""
    depth_m: float
    """Depth of white in an image, m."""
    is_sharp: bool
    """Whether the edges of Booleans stay."""
    is_held: bool
    """A client holds the clay."""
    is_stroke: bool
    """A stroke is under way."""
    is_unsaved: bool
    """Something was done since a session was saved, or since the start."""
    is_over: bool
    """The studio broke: the clay stays as it is, and what is asked for raises `Conflict`."""
    session_at_end: str | None
    """File that the program writes a session to when the run ends, if any."""
    undo: int
    """Strokes that can be taken back."""
    redo: int
    """Strokes that can be done again."""
    trouble: str
    """What went wrong last, for people; else empty."""
    curves_map: tuple[NDArray[np.float64], ...]
    """Curves that wait for a hold of the curve rope, or are pulled: rows x, y, z of each, map frame, m."""
    material: dict[str, float]
    """What the piece is made of where nothing was painted or laid: `mass_kg`, `damping_n_s_per_m`, `stiffness_n_per_m`."""
    has_image: bool
    """An image is embossed, not a round dome."""
    solid: str | None
    """The solid that Booleans take instead of the tool's own shape, in words."""

    @classmethod
    def from_json(cls, said: dict[str, Any]) -> ClayFacts:
        """Takes the facts as the server writes them."""
        least, most = (np.array(said["region_map"][corner], dtype=np.float64) for corner in ("min", "max"))
        least_m, most_m = map(float, said["brush_range_m"])
        same = ("version", "samples", "spacing_m", "craft", "brush_m", "falloff", "color", "depth_m", "is_sharp", "is_held", "is_stroke", "undo", "redo")
        return cls(
            world_from_map=Pose.from_json(said["world_from_map"]),
            region_map=(least, most),
            crafts=tuple(said["crafts"]),
            brush_range_m=(least_m, most_m),
            trouble=said["trouble"],
            # Came later within version 1 of the API.
            is_unsaved=said.get("is_unsaved", False),
            is_over=said.get("is_over", False),
            session_at_end=said.get("session_at_end"),
            curves_map=tuple(np.array(curve, dtype=np.float64).reshape(-1, 3) for curve in said.get("curves_map", ())),
            material=dict(said.get("material", {})),
            has_image=said.get("has_image", False),
            solid=said.get("solid"),
            **{key: said[key] for key in same},
        )


_SAMPLE = np.dtype([("position", "<f4", 3), ("normal", "i1", 3), ("", "u1"), ("color", "u1", 3), ("", "u1")])
_HEAD = np.dtype([("magic", "S4"), ("layout", "<u4"), ("version", "<u8"), ("here", "<u4"), ("all", "<u4"), ("spacing", "<f4"), ("", "<u4")])


@dataclass(frozen=True, slots=True, eq=False)
class ClayPoints:
    """Samples of a piece: all, or of more than 100,000 one in each of so many cells."""

    version: int
    """Version of the samples, for `Clay.points(since=…)`."""
    n_all: int
    """Samples of the piece."""
    spacing_m: float
    """Spacing of those that are here, m."""
    positions_m: NDArray[np.float32]
    """Rows x, y, z, map frame, m."""
    normals: NDArray[np.float32]
    """Rows x, y, z, out of the material, of length 1 to the 127th part."""
    colors: NDArray[np.uint8]
    """Rows red, green, blue, sRGB."""

    @classmethod
    def from_bytes(cls, data: bytes) -> ClayPoints:
        """Takes samples as the server sends them. Raises ValueError for anything else."""
        head = np.frombuffer(data, _HEAD, 1)[0] if len(data) >= _HEAD.itemsize else None
        if head is None or head["magic"] != b"HCLY" or head["layout"] != 1 or len(data) != _HEAD.itemsize + _SAMPLE.itemsize * int(head["here"]):
            raise ValueError("no samples of clay of layout 1")
        rows = np.frombuffer(data, _SAMPLE, offset=_HEAD.itemsize)
        normals = rows["normal"].astype(np.float32) / np.float32(127)
        return cls(int(head["version"]), int(head["all"]), float(head["spacing"]), rows["position"], normals, rows["color"])


class Clay:
    """`Client.clay`. Everything raises `Unknown` in a scene without clay; none of it is a force."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._pings: Every | None = None

    def facts(self) -> ClayFacts:
        """How the piece and the tool stand."""
        return ClayFacts.from_json(self._connection.json("/api/v1/clay"))

    def wait_until(self, condition: Callable[[ClayFacts], bool], timeout_s: float | None = None) -> ClayFacts:
        """The first facts for which the condition holds: they and the samples follow an order by some tens of ms. Raises `NoAnswer` after `timeout_s`."""
        deadline_s = time.monotonic() + (self._connection.timeout_s if timeout_s is None else timeout_s)
        while not condition(facts := self.facts()):
            if time.monotonic() > deadline_s:
                raise NoAnswer(f"what was waited for did not come: {facts.undo} strokes to be undone, {facts.redo} to be redone {facts.trouble}".rstrip())
            time.sleep(LOOK_S)
        return facts

    def points(self, since: int | None = None) -> ClayPoints | None:
        """The samples; None where `since` is the newest version already."""
        query = "" if since is None else f"?since={since}"
        data = self._connection.address.get(f"/api/v1/clay/points{query}", self._connection.timeout_s)
        return None if data is None else ClayPoints.from_bytes(data)

    def take(
        self,
        craft: str | None = None,
        *,
        brush_m: float | None = None,
        falloff: FalloffAsked | None = None,
        color: str | None = None,
        painted: Mapping[str, float] | None = None,
        depth_m: float | None = None,
        is_sharp: bool | None = None,
    ) -> None:
        """Another craft or other settings of the tool; what is not given stays. Ends a stroke.

        `falloff` is a word, a rate as `{"rate": 2.0}` (1 minus the distance over the brush to that power) or weights from the middle of the brush to its
        rim; `color` is `#rrggbb`; `painted` has `mass_kg`, `damping_n_s_per_m` and `stiffness_n_per_m`, and what it lacks is not painted. Raises
        `Invalid` in the server's words for a craft or a value that it does not accept.
        """
        asked: dict[str, object] = {"craft": craft, "brush_m": brush_m, "color": color, "depth_m": depth_m, "is_sharp": is_sharp}
        if falloff is not None:
            asked["falloff"] = _falloff(falloff)
        if painted is not None:
            asked["painted"] = dict(painted)
        self._connection.ask("clay_take", {key: value for key, value in asked.items() if value is not None})

    @contextmanager
    def hold(self) -> Iterator[None]:
        """While the block runs it is as if the arm's first button were held: `with arm.clay.hold(): …`.

        One client at a time, and only while force flows (else `Conflict`); crafts that work by touch take no notice. It ends early when force goes
        off; an event `clay` says `let-go`.
        """
        self._connection.ask("clay_hold", {"held": True})
        self._pings = Every(PING_S, lambda: self._connection.tell("ping"))
        try:
            yield
        finally:
            self.close()
            if self._connection.why_ended() is None:
                self._connection.ask("clay_hold", {"held": False})

    def draw(self, curves_m: Curves, *, is_free: bool = False) -> None:
        """Lays curves for the curve rope, as if they had been drawn: the next hold near one of them with `pull-curve` pulls all of them.

        `curves_m` has rows x, y, z (map frame, m) for each curve; none at all: those that were drawn are gone. Curves are laid onto the surface, which
        is to be within the brush; free ones stay where they are, inside the clay or beside it. Raises `Conflict` where the clay does not take them.
        """
        self._connection.ask("clay_draw", {"curves_m": _listed(curves_m), "is_free": is_free})

    def pull(self, curves_m: Curves, force_n: Sequence[float], time_s: float, *, brush_m: float | None = None, is_free: bool = False) -> None:
        """Pulls curves, or places (curves of one row), with a force of all of them together (map axes, N) for a time: one stroke, and no hand is needed."""
        asked = {"curves_m": _listed(curves_m), "force_n": [float(part) for part in force_n], "time_s": time_s, "is_free": is_free}
        self._connection.ask("clay_pull", asked if brush_m is None else {**asked, "brush_m": brush_m})

    def region(self, least_m: Sequence[float], most_m: Sequence[float]) -> None:
        """Another part deforms: least and largest corner of a box, map frame, m. Raises `Conflict` where nothing of the piece is in it."""
        self._connection.ask("clay_region", {"min": [float(part) for part in least_m], "max": [float(part) for part in most_m]})

    def lay(
        self,
        painted: Mapping[str, float] | None = None,
        *,
        box: tuple[Sequence[float], Sequence[float]] | None = None,
        ball: tuple[Sequence[float], float] | None = None,
        gradient: tuple[Sequence[float], Sequence[float]] | None = None,
    ) -> None:
        """Lays a material, as one stroke: everywhere, in a box (two corners), in a ball (middle, radius), or rising from one place to another.

        `painted` may have `mass_kg`, `damping_n_s_per_m` and `stiffness_n_per_m`; without any, clay ten times as hard. Map frame, m.
        """
        asked: dict[str, Any] = {"painted": dict(painted or {})}
        if box is not None:
            asked["box"] = {"min": list(map(float, box[0])), "max": list(map(float, box[1]))}
        if ball is not None:
            asked["ball"] = {"center": list(map(float, ball[0])), "radius_m": float(ball[1])}
        if gradient is not None:
            asked["gradient"] = {"from": list(map(float, gradient[0])), "to": list(map(float, gradient[1]))}
        self._connection.ask("clay_lay", asked)

    def lay_values(self, places_m: NDArray[np.float64], values: Sequence[Mapping[str, float]], within_m: float = 1e-3) -> None:
        """Lays a material by places, as one stroke: each mass point becomes what the nearest place says, if one is within `within_m`.

        `places_m` has rows x, y, z (map frame, m), `values` for each of them what `painted` of `lay` has; what it lacks stays. Raises `Invalid` where the
        server does not accept one, `Conflict` where they reach no mass point.
        """
        names = ("mass_kg", "damping_n_s_per_m", "stiffness_n_per_m")
        places_mm = np.asarray(places_m, dtype=np.float64).reshape(-1, 3) * 1e3
        rows = [
            ",".join([*(repr(float(x)) for x in place), *("" if said.get(name) is None else repr(float(said[name])) for name in names)])
            for place, said in zip(places_mm, values, strict=True)
        ]
        text = "\n".join(["x_mm,y_mm,z_mm,mass,damping,stiffness", *rows, ""])
        self._connection.address.send("PUT", f"/api/v1/clay/values?within_m={float(within_m)!r}", text.encode(), self._connection.timeout_s)

    def combine(
        self,
        boolean: Literal["union", "intersection", "difference"],
        shape: Mapping[str, Any] | None = None,
        pose: Pose | None = None,
        *,
        is_sharp: bool | None = None,
    ) -> None:
        """Joins the piece with a shape at a pose of the map, or cuts it: `{"sphere_m": r}`, `{"ellipsoid_m": [x, y, z]}` (half
        extents), `{"box_m": [x, y, z]}`, `{"cylinder_m": [r, h]}` or `{"cone_m": [r, h]}`; without a shape with the solid that was chosen."""
        asked: dict[str, Any] = {"boolean": boolean}
        if shape is not None:
            asked["shape"] = dict(shape)
        if pose is not None:
            asked["pose"] = {"p": pose.p.tolist(), "q": pose.q.tolist()}
        if is_sharp is not None:
            asked["is_sharp"] = is_sharp
        self._connection.ask("clay_combine", asked)

    def image(self, png: bytes | None) -> None:
        """What `emboss` and `engrave` lay on the surface from now on: a PNG whose white is deep; None: a round dome."""
        self._connection.address.send("DELETE" if png is None else "PUT", "/api/v1/clay/image", png, self._connection.timeout_s)

    def solid(self, mesh: bytes | None, kind: Literal["stl", "obj", "ply"] = "stl", units: Literal["m", "cm", "mm", "in"] = "mm") -> None:
        """What Booleans work with from now on: a closed mesh, its middle where the tool is; None: the tool's own shape."""
        path = "/api/v1/clay/solid" if mesh is None else f"/api/v1/clay/solid?format={kind}&units={units}"
        self._connection.address.send("DELETE" if mesh is None else "PUT", path, mesh, self._connection.timeout_s)

    def undo(self) -> None:
        """The last stroke back. Raises `Conflict` where there is none."""
        self._connection.ask("clay_undo")

    def redo(self) -> None:
        """And forth again. Raises `Conflict` where there is none."""
        self._connection.ask("clay_redo")

    def save(self, kind: Literal["points", "session", "export"] = "points", file: str | None = None) -> str:
        """Writes samples (PLY), all that is needed to go on, or a closed mesh (PLY), on the machine of the run; returns where it is."""
        said = self._connection.ask("clay_save", {"kind": kind} if file is None else {"kind": kind, "file": file})
        return str(said["file"])

    def close(self) -> None:
        """Says no longer that this client holds the clay."""
        if self._pings is not None:
            self._pings.stop()
            self._pings = None
