"""Recordings (`hapticd run --record FILE.mcap`, `Client.record`) as NumPy arrays, one row per tick. Needs the extra `hapticd[recordings]`.

    from hapticd import recordings

    recording = recordings.load("session.mcap")
    forces_n = recording.command.force_n          # (ticks, 3), device axes
    times_s = recording.timing.time_s             # (ticks,), since the loop began

Units are in the names, SI. Frames: *device* is the arm's own, *world* that of the scene, *tool* that of the tool's mesh file. Every channel with a
row per tick has the same rows. A file that was cut off (a run that was killed) is read up to its last whole tick.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hapticd.records import (
    CHANNELS,
    COMMAND,
    CONTACT,
    DEVICE,
    EACH_TICK,
    FAULTS,
    OBJECTS,
    RENDERED,
    SCENE,
    TIMING,
    TOOL,
    Bools,
    Floats,
    Ints,
    RecordingError,
    Records,
    Words,
)

__all__ = [
    "CHANNELS",
    "CommandWrenches",
    "ContactWrenches",
    "DeviceSamples",
    "FaultMessage",
    "ObjectPoses",
    "RecordedScene",
    "Recording",
    "RecordingError",
    "RenderedWrenches",
    "SceneMessage",
    "Timing",
    "ToolPoses",
    "load",
]

@dataclass(frozen=True, slots=True, eq=False)
class Timing:
    """`/loop/timing`: when each tick was, and how long it took."""

    tick: Ints
    """Number of the tick. A step of more than one: records were dropped there."""
    scene_idx: Ints
    """Number of the scene: an index of `Recording.scenes`."""
    time_s: Floats
    """Time since the loop began, s."""
    wakeup_s: Floats
    """How late the tick began, s."""
    compute_s: Floats
    """What it computed, s."""
    device_s: Floats
    """What the arm's driver took, s."""


@dataclass(frozen=True, slots=True, eq=False)
class DeviceSamples:
    """`/device/sample`: what entered each tick; device axes."""

    position_m: Floats
    """Position of the grip, (n, 3), m."""
    orientation_xyzw: Floats
    """Orientation of the grip, (n, 4)."""
    velocity_m_per_s: Floats
    """Velocity of the grip, (n, 3), m/s."""
    angular_velocity_rad_per_s: Floats
    """Angular velocity of the grip, (n, 3), rad/s."""
    grip_rad: Floats
    """Opening of the gripper, rad."""
    buttons: Ints
    """Buttons, bit 0 first."""
    status: Words
    """`FRESH`, `STALE` or `LOST`."""
    request: Words
    """What the supervisor asked for: `DISABLE`, `ENABLE` or `STOP`."""
    overrun: Bools
    """The tick came too late."""


@dataclass(frozen=True, slots=True, eq=False)
class ToolPoses:
    """`/tool/pose`: the tool's mesh frame in the world."""

    position_m: Floats
    """Its origin, (n, 3), m, world."""
    orientation_xyzw: Floats
    """Its orientation, (n, 4), `world_from_tool`."""


@dataclass(frozen=True, slots=True, eq=False)
class ObjectPoses:
    """`/object/pose`: parts that were under way, one row for each message; none while nothing moves."""

    tick: Ints
    """Number of the tick (its lowest 32 bits)."""
    object_idx: Ints
    """Which fixed object, in the order of the scene."""
    position_m: Floats
    """Where it stands, (n, 3), m, world."""
    orientation_xyzw: Floats
    """Its orientation, (n, 4), `world_from_object`."""


@dataclass(frozen=True, slots=True, eq=False)
class ContactWrenches:
    """`/wrench/contact`: the raw contact on the tool, before filter, coupling and limits; world axes, about its centre of mass."""

    force_n: Floats
    """Force on the tool, (n, 3), N, world axes."""
    torque_nm: Floats
    """Torque on the tool, (n, 3), N·m, world axes, about its centre of mass."""
    contacts: Ints
    """Points in contact."""
    max_depth_m: Floats
    """Depth of the deepest point, m; 0 without contact."""
    clearance_m: Floats
    """How far the tool is from contact, m, as far as the distance field reaches."""
    points_left_out: Ints
    """Points that the time budget left out."""
    depth_is_bound: Bools
    """Where it may be deeper: the layers of an object end there; false in recordings of 0.1.0."""


@dataclass(frozen=True, slots=True, eq=False)
class CommandWrenches:
    """`/wrench/command`: what each tick decided; device axes, about the grip point."""

    force_n: Floats
    """Force that was commanded, (n, 3), N, device axes."""
    torque_nm: Floats
    """Torque that was commanded, (n, 3), N·m, device axes."""
    wanted_force_n: Floats
    """The same before axes without a motor were dropped, (n, 3), N."""
    wanted_torque_nm: Floats
    """The same before axes without a motor were dropped, (n, 3), N·m."""
    drive: Words
    """`DISABLED`, `ENABLING`, `ENABLED`, `STOPPING`, `BRAKING` or `FAULT`."""
    off_cause: Words
    """Why no force flowed, such as `not-homed`, or `none`."""
    faults: Ints
    """Bits of the faults: `hapticd.fault_names` has their names."""
    energy_j: Floats
    """Energy taken from the hand since enable, J."""
    passivity_active: Bools
    """The tick was damped, as the arm would have given the hand more energy than it took."""


@dataclass(frozen=True, slots=True, eq=False)
class RenderedWrenches:
    """`/wrench/rendered`: what the motors made of the command; device axes, about the grip point."""

    force_n: Floats
    """Force, (n, 3), N, device axes."""
    torque_nm: Floats
    """Torque, (n, 3), N·m, device axes."""


@dataclass(frozen=True, slots=True)
class FaultMessage:
    """`/faults`: faults appeared, changed or were acknowledged."""

    tick: int
    """Number of the tick (its lowest 32 bits)."""
    text: str
    """Names and words of the faults."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class SceneMessage:
    """`/scene`: what viewers show of the parts, when a scene begins."""

    tick: int
    """Number of the tick (its lowest 32 bits)."""
    update: Any
    """The message, a `foxglove.SceneUpdate`."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class RecordedScene:
    """A scene that was rendered, as the file brings it along."""

    name: str
    """Its name."""
    path: str
    """Its file at the time."""
    toml: str
    """The scene as written."""
    resolved: dict[str, Any]
    """What it comes to: every value with its default, SI."""

    def __repr__(self) -> str:
        """Its name and file: the text has hundreds of lines."""
        return f"<RecordedScene {self.name!r} of {self.path}>"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Recording:
    """A recording in memory. Channels that were not asked for, and channels of no message, have no rows."""

    path: Path
    """The file."""
    run: dict[str, str]
    """Program, clock, rate, arm, what the machine lacked."""
    scenes: tuple[RecordedScene, ...]
    """Those that were rendered, in turn."""
    is_whole: bool
    """The file has its end; else it was cut off and more was felt than it has."""
    dropped: int | None
    """Ticks that the recorder dropped; None in a file without its end."""
    timing: Timing
    """When each tick was, and how long it took."""
    device: DeviceSamples
    """What entered each tick; device axes."""
    tool: ToolPoses
    """Where the tool was; world."""
    objects: ObjectPoses
    """Parts that were under way; world. Its rows are messages, not ticks."""
    contact: ContactWrenches
    """The raw contact on the tool; world axes."""
    command: CommandWrenches
    """What each tick decided; device axes."""
    rendered: RenderedWrenches
    """What the motors made of it; device axes."""
    faults: tuple[FaultMessage, ...]
    """Faults that appeared, changed or were acknowledged."""
    shown: tuple[SceneMessage, ...] = ()
    """What viewers show of the parts, with their meshes."""
    began_ns: int | None = None
    """What the wall clock showed at loop time zero, ns since 1970; None under the virtual clock."""

    def __len__(self) -> int:
        """Ticks."""
        return len(self.timing.tick)

    def __repr__(self) -> str:
        """One line: file, length, arm, scenes, and what is missing or went wrong. The arrays of a minute would be pages."""
        times_s = self.timing.time_s
        parts = [f"{len(self)} ticks", f"{times_s[-1] - times_s[0]:.3f} s at {self.rate_hz:g} Hz", self.run.get("device", "")]
        parts.append(", ".join(repr(scene.name) for scene in self.scenes))
        parts += [f"{self.dropped} dropped"] if self.dropped else []
        parts += [f"{len(self.faults)} messages of faults"] if self.faults else []
        parts += [] if self.is_whole else ["cut off"]
        return f"<Recording {str(self.path)!r}: {'; '.join(part for part in parts if part)}>"

    @property
    def rate_hz(self) -> float:
        """Ticks per second of the loop."""
        return float(self.run["rate_hz"])


def load(path: str | Path, channels: Collection[str] = CHANNELS) -> Recording:
    """Reads a recording into memory: some 600 bytes for each tick, twice as many while it reads.

    Cost: some 0.2 ms for each tick, as Python decodes each message by itself; `channels` (such as `["/wrench/command"]`, the times always come) makes
    it less. A damaged file is read up to the damage, as if it were cut there. Raises `RecordingError` for what is no recording of hapticd,
    and OSError where it cannot be read.
    """
    if unknown := set(channels) - set(CHANNELS):
        raise ValueError(f"no channel is called {', '.join(sorted(unknown))}; known: {', '.join(CHANNELS)}")
    path = Path(path)
    read = Records(path, {TIMING, *channels})
    read.file()
    if read.run is None or not len(read.tables[TIMING].ticks()):
        raise RecordingError(f"{path}: no recording of hapticd, or cut before its first tick")
    try:
        return _recording(path, read)
    except RecordingError:
        raise
    except (AttributeError, KeyError, IndexError, ValueError) as error:
        raise RecordingError(f"{path}: not as this version writes it: {error!r}") from error


def _recording(path: Path, read: Records) -> Recording:
    timing = read.tables[TIMING]
    ticks = timing.ticks()
    for topic in EACH_TICK:
        # The times are the last message of a tick: what a cut file has beyond them is of a tick that is not whole.
        table = read.tables[topic]
        table.cut(len(ticks))
        if topic in read.wanted and not np.array_equal(table.ticks(), ticks):
            raise RecordingError(f"{path}: {topic} and {TIMING} are not of the same ticks")
    device, tool, objects = (read.tables[topic] for topic in (DEVICE, TOOL, OBJECTS))
    contact, command, rendered = (read.tables[topic] for topic in (CONTACT, COMMAND, RENDERED))
    faults, shown = read.tables[FAULTS], read.tables[SCENE]
    return Recording(
        path=path,
        run=read.run or {},
        scenes=tuple(_scenes(read)),
        is_whole=read.is_whole,
        dropped=None if read.end is None else int(read.end["dropped"]),
        timing=Timing(timing.ints(0), timing.ints(1), *(timing.seconds(column) for column in (2, 3, 4, 5))),
        device=DeviceSamples(
            position_m=device.floats(0, 3),
            orientation_xyzw=device.floats(3, 4),
            velocity_m_per_s=device.floats(7, 3),
            angular_velocity_rad_per_s=device.floats(10, 3),
            grip_rad=device.float(13),
            buttons=device.ints(14),
            status=device.words(0),
            request=device.words(1),
            overrun=device.bools(15),
        ),
        tool=ToolPoses(tool.floats(0, 3), tool.floats(3, 4)),
        objects=ObjectPoses(
            tick=objects.ticks(),
            object_idx=objects.ints(7),
            position_m=objects.floats(0, 3),
            orientation_xyzw=objects.floats(3, 4),
        ),
        contact=ContactWrenches(
            force_n=contact.floats(0, 3),
            torque_nm=contact.floats(3, 3),
            max_depth_m=contact.float(6),
            clearance_m=contact.float(7),
            contacts=contact.ints(8),
            points_left_out=contact.ints(9),
            depth_is_bound=contact.bools(10),
        ),
        command=CommandWrenches(
            force_n=command.floats(0, 3),
            torque_nm=command.floats(3, 3),
            wanted_force_n=command.floats(6, 3),
            wanted_torque_nm=command.floats(9, 3),
            energy_j=command.float(12),
            faults=command.ints(13),
            passivity_active=command.bools(14),
            drive=command.words(0),
            off_cause=command.words(1),
        ),
        rendered=RenderedWrenches(rendered.floats(0, 3), rendered.floats(3, 3)),
        faults=tuple(FaultMessage(int(tick), str(text)) for tick, text in zip(faults.ticks(), faults.words(0))),
        shown=tuple(SceneMessage(int(tick), update) for tick, update in zip(shown.ticks(), shown.messages())),
        began_ns=read.zero_ns if (read.run or {}).get("clock") != "virtual" else None,
    )


def _scenes(read: Records) -> Iterator[RecordedScene]:
    for name in sorted(read.scenes, key=lambda name: int(name.removeprefix("scenes/"))):
        facts = read.scenes[name]
        toml, resolved = (read.attachments.get(f"{name}/{file}") for file in ("scene.toml", "resolved.json"))
        # A cut file may end between them.
        if toml is not None and resolved is not None:
            yield RecordedScene(facts["name"], facts["path"], toml.decode(), json.loads(resolved))
