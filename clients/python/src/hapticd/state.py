"""States of a run: as a dataclass with everything there is to know (JSON), or as rows of a NumPy array (binary, for high rates).

Names follow the Collaborative Robotics Toolkit: `measured_` is what the arm did, `servo_` what it was commanded, `_cp` a pose, `_cv` a velocity, `_cf` a
wrench. `docs/reference/api.md`, sections 5 and 6.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
"""Numbers of one kind. What the server calls null, as it is no number, is NaN."""


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """Where something is."""

    p: Vector
    """Position, m."""
    q: Vector
    """Orientation, a unit quaternion x, y, z, w."""

    @classmethod
    def from_json(cls, said: dict[str, Any]) -> Pose:
        """Takes a pose as the server writes it, `{"p": [3], "q": [4]}`."""
        return cls(_vector(said["p"]), _vector(said["q"]))


@dataclass(frozen=True, slots=True, eq=False)
class Twist:
    """How something moves."""

    v: Vector
    """Velocity, m/s."""
    w: Vector
    """Angular velocity, rad/s."""


@dataclass(frozen=True, slots=True, eq=False)
class Wrench:
    """Force and torque."""

    f: Vector
    """Force, N."""
    t: Vector
    """Torque, N·m."""


@dataclass(frozen=True, slots=True, eq=False)
class LastFault:
    """The fault that last took the force, also after it was acknowledged."""

    tick: int
    """Number of the tick in which it appeared."""
    time_ns: int
    """Time of that tick since the loop began, ns."""
    names: tuple[str, ...]
    """Names of the faults."""


@dataclass(frozen=True, slots=True)
class HandUse:
    """An order for the hand of a simulated arm that a tick has used."""

    order: int
    """Its number, from 1; each `move_to` and `restart` of any client is one."""
    waited_us: int
    """From when the run took it until a tick had read the first sample of the arm that it moved, µs."""


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """One state of a run, of one tick."""

    seq: int
    """States that this client was sent, from 1 on. A gap: the reader was slow, and older states made way."""
    dropped: int
    """States that were due and were not sent."""
    tick: int
    """Number of the tick."""
    time_ns: int
    """Time of the tick since the loop began, ns."""
    scene_idx: int
    """Number of the scene."""
    state: str
    """`DISABLED`, `ENABLED`, `PAUSED` or `FAULT`."""
    is_busy: bool
    """On the way from one state to another."""
    phase: str
    """`disabled`, `enabling`, `enabled`, `stopping`, `braking`, `fault` or `stopped`."""
    off_cause: str
    """Why no force flows, or `none`."""
    advice: str
    """What to do about it, for people."""
    faults: tuple[str, ...]
    """Names of the faults that are active: they stay until they are acknowledged by `disable`."""
    last_fault: LastFault | None
    """The fault that last took the force; None when force has come in again."""
    measured_cp: Pose
    """Pose of the grip, device axes."""
    measured_cv: Twist
    """Velocity of the grip, device axes."""
    servo_cf: Wrench
    """Wrench that was commanded; device axes, about the grip point."""
    measured_cf: Wrench
    """What the motors made of it; device axes, about the grip point."""
    tool_cp: Pose
    """Pose of the tool in the world."""
    device_cp_world: Pose | None
    """Where the arm wants the tool, world; None while no force may flow."""
    contact_cf: Wrench
    """Raw contact wrench on the tool; world axes, about its centre of mass."""
    contacts: int
    """Points in contact."""
    max_depth_m: float
    """Depth of the deepest point, m; 0 without contact."""
    depth_is_bound: bool
    """It may be deeper: the layers of an object end there."""
    clearance_m: float
    """How far the tool is from contact, m, as far as the distance field reaches."""
    energy_j: float
    """Energy taken from the hand since enable, J."""
    grip_rad: float
    """Opening of the gripper, rad."""
    buttons: int
    """Buttons, bit 0 first."""
    wakeup_us: float
    """How late the tick began, µs."""
    compute_us: float
    """What the tick computed, µs."""
    device_us: float
    """What the arm's driver took, µs."""
    objects: dict[int, Pose]
    """Movable objects in the world, by their place in `Client.scene().objects`."""
    hand: HandUse | None
    """The newest order for the hand that was used; None before the first one."""
    points: Vector | None
    """Contact points as rows x, y, z, depth, world, m; None where they were not asked for, or are as before."""
    points_of: int | None
    """How many points are in contact, of which `points` are some; None as there."""
    history: Vector | None
    """Rows of time (s), measured force (N), depth (mm), compute (µs), wake-up (µs) since the last state; None where it was not asked for."""

    @property
    def time_s(self) -> float:
        """Time of the tick since the loop began, s."""
        return self.time_ns * 1e-9

    @classmethod
    def from_json(cls, said: dict[str, Any]) -> State:
        """Takes a state as the server writes it. Keys that this version does not know are ignored, as the protocol wants."""
        fault, wanted = said["last_fault"], said["device_cp_world"]
        points, history, hand = said.get("points"), said.get("history"), said.get("hand")
        return cls(
            seq=said["seq"],
            dropped=said["dropped"],
            tick=said["tick"],
            time_ns=said["time_ns"],
            scene_idx=said["scene_idx"],
            state=said["state"],
            is_busy=said["is_busy"],
            phase=said["phase"],
            off_cause=said["off_cause"],
            advice=said["advice"],
            faults=tuple(said["faults"]),
            last_fault=None if fault is None else LastFault(fault["tick"], fault["time_ns"], tuple(fault["names"])),
            measured_cp=Pose.from_json(said["measured_cp"]),
            measured_cv=Twist(_vector(said["measured_cv"]["v"]), _vector(said["measured_cv"]["w"])),
            servo_cf=_wrench(said["servo_cf"]),
            measured_cf=_wrench(said["measured_cf"]),
            tool_cp=Pose.from_json(said["tool_cp"]),
            device_cp_world=None if wanted is None else Pose.from_json(wanted),
            contact_cf=_wrench(said["contact_cf"]),
            contacts=said["contacts"],
            max_depth_m=number(said["max_depth_m"]),
            # Servers of 0.1.0 do not say it.
            depth_is_bound=said.get("depth_is_bound", False),
            clearance_m=number(said["clearance_m"]),
            energy_j=number(said["energy_j"]),
            grip_rad=number(said["grip_rad"]),
            buttons=said["buttons"],
            wakeup_us=number(said["wakeup_us"]),
            compute_us=number(said["compute_us"]),
            device_us=number(said["device_us"]),
            objects={stand["idx"]: Pose.from_json(stand) for stand in said["objects"]},
            hand=None if hand is None else HandUse(hand["order"], hand["waited_us"]),
            points=None if points is None else _vector(points).reshape(-1, 4),
            points_of=said.get("points_of"),
            history=None if history is None else _vector(history).reshape(-1, 5),
        )


def number(said: float | None) -> float:
    """A number as the server writes it, where null is none."""
    return float("nan") if said is None else float(said)


def _vector(said: Any) -> Vector:
    # NumPy makes NaN of None.
    return np.array(said, dtype=np.float64)


def _wrench(said: dict[str, Any]) -> Wrench:
    return Wrench(_vector(said["f"]), _vector(said["t"]))


_POSE = np.dtype([("p", "<f8", 3), ("q", "<f8", 4)])
_WRENCH = np.dtype([("f", "<f8", 3), ("t", "<f8", 3)])

STATE_DTYPE: np.dtype[np.void] = np.dtype(
    {
        "names": [
            "magic", "version", "tick", "time_ns", "seq", "dropped", "flags", "faults", "measured_cp", "tool_cp", "servo_cf", "measured_cf", "contact_cf",
            "max_depth_m", "clearance_m", "contacts", "wakeup_us", "compute_us", "device_us", "scene_idx", "buttons",
        ],
        "formats": [
            "S4", "<u4", "<u8", "<i8", "<u8", "<u8", "<u4", "<u4", _POSE, _POSE, _WRENCH, _WRENCH, _WRENCH,
            "<f8", "<f8", "<u4", "<f4", "<f4", "<f4", "<u4", "<u4",
        ],
        "offsets": [0, 4, 8, 16, 24, 32, 40, 44, 48, 104, 160, 208, 256, 304, 312, 320, 324, 328, 332, 336, 340],
        "itemsize": 344,
    }
)  # fmt: skip
"""Layout of a binary state, version 1: units and frames as in `State`. `rows["servo_cf"]["f"]` is an array of forces, one row per state."""

STATES = ("DISABLED", "ENABLED", "PAUSED", "FAULT")
"""Bits 0 and 1 of `flags`; bit 3 is `is_busy`, bit 4 `depth_is_bound`."""

OFF_CAUSES = (
    "none", "button", "velocity", "watchdog", "software", "disconnected", "deadman", "stale", "non-finite", "power", "thermal", "not-homed",
    "sign-check", "protocol", "overrun", "workspace", "link",
)  # fmt: skip
"""Bits 8 to 15 of `flags`. A client that fell silent is `software` here."""

FAULTS = (
    "non-finite", "speed", "stale", "disconnected", "overrun", "position-jump", "panic", "solver", "stuck", "power", "not-homed", "protocol",
    "device-error", "sequence-gap", "thermal", "link",
)  # fmt: skip
"""Bits of `faults`, from bit 0 on."""


def decode(messages: list[bytes]) -> NDArray[np.void]:
    """Binary states as an array of `STATE_DTYPE`, one row each. Raises ValueError for what is no state of version 1."""
    if any(len(message) != STATE_DTYPE.itemsize for message in messages):
        raise ValueError(f"a binary state has {STATE_DTYPE.itemsize} bytes, not {sorted({len(message) for message in messages})}")
    rows = np.frombuffer(b"".join(messages), dtype=STATE_DTYPE)
    if np.any(rows["magic"] != b"HSTA") or np.any(rows["version"] != 1):
        raise ValueError("no binary states of version 1")
    return rows


def state_names(rows: NDArray[np.void]) -> NDArray[np.str_]:
    """`DISABLED`, `ENABLED`, `PAUSED` or `FAULT` for each row of binary states."""
    names: NDArray[np.str_] = np.array(STATES)[rows["flags"] & 3]
    return names


def off_causes(rows: NDArray[np.void]) -> NDArray[np.str_]:
    """Why no force flowed, or `none`, for each row of binary states; `other` for a cause that this version does not know."""
    numbers = (rows["flags"] >> 8) & 0xFF
    causes: NDArray[np.str_] = np.array([*OFF_CAUSES, "other"])[np.minimum(numbers, len(OFF_CAUSES))]
    return causes


def fault_names(bits: int) -> tuple[str, ...]:
    """Names of the faults in `faults` of one binary state or one tick of a recording."""
    return tuple(FAULTS[bit] if bit < len(FAULTS) else f"bit-{bit}" for bit in range(32) if int(bits) >> bit & 1)
