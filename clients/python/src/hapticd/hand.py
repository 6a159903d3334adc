"""The hand of a simulated arm, moved by this client: it goes through the same loop, and is stopped by the same parts, as any other hand."""

from __future__ import annotations

import time
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from hapticd.connection import Connection
from hapticd.state import Pose

FOLLOW_HZ = 100.0
"""How often `follow` says where the hand is to be."""


class Hand:
    """What moves the hand of a simulated arm. Every method raises `Conflict` where a person holds the arm, or no hand does."""

    def __init__(self, connection: Connection) -> None:
        """Use `Client.hand`."""
        self._connection = connection

    def move_to(self, position_m: Pose | ArrayLike, orientation_xyzw: ArrayLike = (0.0, 0.0, 0.0, 1.0)) -> None:
        """Asks the hand to hold the tool's frame at a pose in the world: a `Pose`, or a position with an orientation.

        It goes there at 0.25 m/s and 3 rad/s of the grip at most and pulls with 0.7 of what the motors can push at most: a part in the way stops it.
        It stays there until it is told something else, also when this client ends. Returns when the loop has the order.
        """
        pose = position_m if isinstance(position_m, Pose) else Pose(_vector(position_m), _vector(orientation_xyzw))
        self._connection.ask("hand", {"pose": {"p": pose.p.tolist(), "q": pose.q.tolist()}})

    def follow(self, path: Iterable[tuple[float, Pose]]) -> None:
        """Moves along a path, `(seconds, pose)` with rising seconds; between two of them along a line. Returns at its end.

        Raises ValueError where the seconds do not rise.
        """
        begun_s, before = time.monotonic(), None
        for at_s, pose in path:
            if before is not None and at_s <= before[0]:
                raise ValueError(f"the path's times rise: {at_s} s comes after {before[0]} s")
            begins_s, begin = before or (at_s, pose)
            if before is None:
                begun_s -= at_s
            while (now_s := time.monotonic() - begun_s) < at_s:
                self.move_to(_between(begin, pose, (now_s - begins_s) / (at_s - begins_s)))
                time.sleep(1.0 / FOLLOW_HZ)
            self.move_to(pose)
            before = (at_s, pose)

    def restart(self) -> None:
        """Asks the hand to follow the scene's path again: back along it to its beginning, and forth."""
        self._connection.ask("restart_hand")


def _between(begin: Pose, end: Pose, share: float) -> Pose:
    """Linear in the position; of the orientation the normalised line, which is near enough between poses of a path."""
    nearer = end.q if np.dot(begin.q, end.q) >= 0.0 else -end.q
    q = begin.q + (nearer - begin.q) * share
    return Pose(begin.p + (end.p - begin.p) * share, q / np.linalg.norm(q))


def _vector(numbers: ArrayLike) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return np.asarray(numbers, dtype=np.float64)
