"""What clients do to clay (`hapticd sculpt`): choose the craft, hold, take strokes back, save, and look at the samples. `docs/reference/api.md`, section 12."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
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
    """`gaussian`, `constant`, `spherical` or `table`."""
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
        falloff: str | Sequence[float] | None = None,
        color: str | None = None,
        depth_m: float | None = None,
        is_sharp: bool | None = None,
    ) -> None:
        """Another craft or other settings of the tool; what is not given stays. Ends a stroke.

        `falloff` is a word or weights from the middle of the brush to its rim, `color` `#rrggbb`. Raises `Invalid` in the server's words for a craft or
        a value that it does not accept.
        """
        listed = falloff if falloff is None or isinstance(falloff, str) else [float(weight) for weight in falloff]
        asked = {"craft": craft, "brush_m": brush_m, "falloff": listed, "color": color, "depth_m": depth_m, "is_sharp": is_sharp}
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
