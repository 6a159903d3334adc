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
import struct
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hapticd.errors import HapticdError

try:
    from google.protobuf.message import DecodeError
    from mcap.exceptions import McapError
    from mcap.records import Attachment, Channel, Footer, Header, Message, Metadata, Schema
    from mcap.stream_reader import StreamReader
    from mcap_protobuf.decoder import DecoderFactory
except ImportError as missing:
    raise ImportError("recordings need the packages mcap and mcap-protobuf-support: pip install 'hapticd[recordings]'") from missing

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Words = NDArray[np.str_]


class RecordingError(HapticdError, ValueError):
    """The file is no recording of hapticd, or a damaged one."""


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
    """What the supervisor asked for: `DISABLE`, `ENABLE`, `STOP` or `PAUSE`."""
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


@dataclass(frozen=True, slots=True, eq=False)
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


@dataclass(frozen=True, slots=True, eq=False)
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
    device: DeviceSamples
    tool: ToolPoses
    objects: ObjectPoses
    contact: ContactWrenches
    command: CommandWrenches
    rendered: RenderedWrenches
    faults: tuple[FaultMessage, ...]

    def __len__(self) -> int:
        """Ticks."""
        return len(self.timing.tick)

    @property
    def rate_hz(self) -> float:
        """Ticks per second of the loop."""
        return float(self.run["rate_hz"])


TIMING, DEVICE, TOOL, OBJECTS = "/loop/timing", "/device/sample", "/tool/pose", "/object/pose"
CONTACT, COMMAND, RENDERED, FAULTS = "/wrench/contact", "/wrench/command", "/wrench/rendered", "/faults"
EACH_TICK = (DEVICE, TOOL, CONTACT, COMMAND, RENDERED)
CHANNELS = (*EACH_TICK, OBJECTS, FAULTS)


def load(path: str | Path, channels: Collection[str] = CHANNELS) -> Recording:
    """Reads a recording into memory: some 500 bytes for each tick.

    Cost: a minute at 1 kHz takes some ten seconds, as each message is decoded by itself; `channels` (such as `["/wrench/command"]`, the times always
    come) makes it less. A damaged file is read up to the damage, as if it were cut there. Raises `RecordingError` for what is no recording of hapticd,
    and OSError where it cannot be read.
    """
    if unknown := set(channels) - set(CHANNELS):
        raise ValueError(f"no channel is called {', '.join(sorted(unknown))}; known: {', '.join(CHANNELS)}")
    path = Path(path)
    read = _Read(path, {TIMING, *channels})
    read.file()
    if read.run is None or not read.sequences[TIMING]:
        raise RecordingError(f"{path}: no recording of hapticd, or cut before its first tick")
    try:
        return _recording(path, read)
    except (AttributeError, KeyError, IndexError, ValueError) as error:
        raise RecordingError(f"{path}: not as this version writes it: {error!r}") from error


class _Read:
    """Records of a file in the order in which they were written."""

    def __init__(self, path: Path, wanted: set[str]) -> None:
        self.path, self.wanted = path, wanted
        self.rows: dict[str, list[tuple[Any, ...]]] = {topic: [] for topic in wanted}
        self.sequences: dict[str, list[int]] = {topic: [] for topic in wanted}
        self.run: dict[str, str] | None = None
        self.end: dict[str, str] | None = None
        self.scenes: dict[str, dict[str, str]] = {}
        self.attachments: dict[str, bytes] = {}
        self.is_whole = False
        self._schemas: dict[int, Schema] = {}
        self._readers: dict[int, tuple[str, Callable[[bytes], Any]]] = {}
        self._decoders = DecoderFactory()

    def file(self) -> None:
        with open(self.path, "rb") as file:
            has_begun = False
            records: Iterator[Any] = StreamReader(file, emit_chunks=False, validate_crcs=True).records
            try:
                for record in records:
                    has_begun = has_begun or isinstance(record, Header)
                    self._take(record)
            except RecordingError:
                raise
            # A cut file ends in the middle of a record, or of what a record was packed into: whatever the library says then.
            except (McapError, DecodeError, struct.error, RuntimeError, EOFError, ValueError, LookupError) as error:
                if not has_begun:
                    raise RecordingError(f"{self.path}: no MCAP file: {error!r}") from error

    def _take(self, record: Any) -> None:
        match record:
            case Message():
                if (reader := self._readers.get(record.channel_id)) is not None:
                    topic, decode = reader
                    self.rows[topic].append(ROWS[topic](decode(record.data)))
                    self.sequences[topic].append(record.sequence)
            case Schema():
                self._schemas[record.id] = record
            case Channel():
                if record.topic in self.wanted and record.id not in self._readers:
                    reads = self._decoders.decoder_for(record.message_encoding, self._schemas.get(record.schema_id))
                    if reads is None:
                        raise RecordingError(f"{self.path}: messages of {record.topic} are not protobuf")
                    self._readers[record.id] = (record.topic, reads)
            case Metadata():
                match record.name:
                    case "run":
                        self.run = record.metadata
                    case "end":
                        self.end = record.metadata
                    case name if name.startswith("scenes/"):
                        self.scenes[name] = record.metadata
            case Attachment():
                if record.name.endswith(("/scene.toml", "/resolved.json")):
                    self.attachments[record.name] = record.data
            case Footer():
                self.is_whole = True


def _vector(v: Any) -> tuple[float, float, float]:
    return v.x, v.y, v.z


def _pose(pose: Any) -> tuple[float, ...]:
    p, q = pose.position, pose.orientation
    return p.x, p.y, p.z, q.x, q.y, q.z, q.w


@cache
def _word(enum: Any, number: int) -> str:
    """Word of an enumeration, without the name of the enumeration before it; a number that it does not know as such."""
    value = enum.values_by_number.get(number)
    return str(number) if value is None else str(value.name).removeprefix(f"{enum.name.upper()}_")


def _choice(message: Any, field: str) -> str:
    return _word(message.DESCRIPTOR.fields_by_name[field].enum_type, getattr(message, field))


def _of_timing(m: Any) -> tuple[Any, ...]:
    return m.tick, m.scene_idx, m.time_ns, m.wakeup_ns, m.compute_ns, m.device_ns


def _of_device(m: Any) -> tuple[Any, ...]:
    moves = (*_pose(m.pose), *_vector(m.linear_velocity), *_vector(m.angular_velocity), m.grip_rad)
    return (*moves, m.buttons, _choice(m, "status"), _choice(m, "request"), m.overrun)


def _of_tool(m: Any) -> tuple[Any, ...]:
    return _pose(m.pose)


def _of_object(m: Any) -> tuple[Any, ...]:
    return (*_pose(m.world_from_object), m.object_idx)


def _of_contact(m: Any) -> tuple[Any, ...]:
    return (*_vector(m.force), *_vector(m.torque), m.max_depth_m, m.clearance_m, m.contacts, m.points_left_out)


def _of_command(m: Any) -> tuple[Any, ...]:
    wrenches = (*_vector(m.force), *_vector(m.torque), *_vector(m.wanted_force), *_vector(m.wanted_torque), m.energy_j)
    return (*wrenches, m.faults, m.passivity_active, _choice(m, "drive"), _choice(m, "off_cause").lower().replace("_", "-"))


def _of_rendered(m: Any) -> tuple[Any, ...]:
    return (*_vector(m.force), *_vector(m.torque))


def _of_fault(m: Any) -> tuple[Any, ...]:
    return (m.message,)


ROWS: dict[str, Callable[[Any], tuple[Any, ...]]] = {
    TIMING: _of_timing,
    DEVICE: _of_device,
    TOOL: _of_tool,
    OBJECTS: _of_object,
    CONTACT: _of_contact,
    COMMAND: _of_command,
    RENDERED: _of_rendered,
    FAULTS: _of_fault,
}
"""What is kept of a message of each channel."""


class _Columns:
    """Rows of a channel by column."""

    def __init__(self, rows: list[tuple[Any, ...]]) -> None:
        self._columns = list(zip(*rows))

    def floats(self, begin: int, width: int) -> Floats:
        """Some columns side by side, (n, width)."""
        columns = self._columns[begin : begin + width]
        return np.array(columns, dtype=np.float64).T.copy() if columns else np.empty((0, width))

    def float(self, column: int) -> Floats:
        return np.array(self._column(column), dtype=np.float64)

    def seconds(self, column: int) -> Floats:
        """A column of nanoseconds."""
        return np.array(self._column(column), dtype=np.float64) * 1e-9

    def ints(self, column: int) -> Ints:
        return np.array(self._column(column), dtype=np.int64)

    def bools(self, column: int) -> Bools:
        return np.array(self._column(column), dtype=np.bool_)

    def words(self, column: int) -> Words:
        return np.array(self._column(column), dtype=np.str_)

    def _column(self, column: int) -> tuple[Any, ...]:
        return self._columns[column] if self._columns else ()


def _recording(path: Path, read: _Read) -> Recording:
    ticks = read.sequences[TIMING]

    def columns(topic: str) -> _Columns:
        rows = read.rows.get(topic, [])
        if topic in EACH_TICK and rows:
            # The times are the last message of a tick: what a cut file has beyond them is of a tick that is not whole.
            if read.sequences[topic][: len(ticks)] != ticks:
                raise RecordingError(f"{path}: {topic} and {TIMING} are not of the same ticks")
            rows = rows[: len(ticks)]
        return _Columns(rows)

    timing, device, tool, objects = (columns(topic) for topic in (TIMING, DEVICE, TOOL, OBJECTS))
    contact, command, rendered = (columns(topic) for topic in (CONTACT, COMMAND, RENDERED))
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
            status=device.words(15),
            request=device.words(16),
            overrun=device.bools(17),
        ),
        tool=ToolPoses(tool.floats(0, 3), tool.floats(3, 4)),
        objects=ObjectPoses(
            tick=np.array(read.sequences.get(OBJECTS, []), dtype=np.int64),
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
        ),
        command=CommandWrenches(
            force_n=command.floats(0, 3),
            torque_nm=command.floats(3, 3),
            wanted_force_n=command.floats(6, 3),
            wanted_torque_nm=command.floats(9, 3),
            energy_j=command.float(12),
            faults=command.ints(13),
            passivity_active=command.bools(14),
            drive=command.words(15),
            off_cause=command.words(16),
        ),
        rendered=RenderedWrenches(rendered.floats(0, 3), rendered.floats(3, 3)),
        faults=tuple(FaultMessage(tick, row[0]) for tick, row in zip(read.sequences.get(FAULTS, []), read.rows.get(FAULTS, []))),
    )


def _scenes(read: _Read) -> Iterator[RecordedScene]:
    for name in sorted(read.scenes, key=lambda name: int(name.removeprefix("scenes/"))):
        facts = read.scenes[name]
        toml = read.attachments[f"{name}/scene.toml"].decode()
        yield RecordedScene(facts["name"], facts["path"], toml, json.loads(read.attachments[f"{name}/resolved.json"]))
