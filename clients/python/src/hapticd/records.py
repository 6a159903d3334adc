"""Records of a recording file, read one after the other up to its end, or to where it was cut, and laid out as columns."""

from __future__ import annotations

import struct
from array import array
from collections.abc import Callable, Iterator
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
Row = tuple[Any, ...]


class RecordingError(HapticdError, ValueError):
    """The file is no recording of hapticd, or a damaged one."""


TIMING, DEVICE, TOOL, OBJECTS = "/loop/timing", "/device/sample", "/tool/pose", "/object/pose"
CONTACT, COMMAND, RENDERED, FAULTS, SCENE = "/wrench/contact", "/wrench/command", "/wrench/rendered", "/faults", "/scene"
EACH_TICK = (DEVICE, TOOL, CONTACT, COMMAND, RENDERED)
CHANNELS = (*EACH_TICK, OBJECTS, FAULTS, SCENE)


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


def _of_timing(m: Any) -> Row:
    return m.tick, m.scene_idx, m.time_ns, m.wakeup_ns, m.compute_ns, m.device_ns


def _of_device(m: Any) -> Row:
    moves = (*_pose(m.pose), *_vector(m.linear_velocity), *_vector(m.angular_velocity), m.grip_rad)
    return (*moves, m.buttons, m.overrun, _choice(m, "status"), _choice(m, "request"))


def _of_tool(m: Any) -> Row:
    return _pose(m.pose)


def _of_object(m: Any) -> Row:
    return (*_pose(m.world_from_object), m.object_idx)


def _of_contact(m: Any) -> Row:
    return (*_vector(m.force), *_vector(m.torque), m.max_depth_m, m.clearance_m, m.contacts, m.points_left_out, getattr(m, "depth_is_bound", False))


def _of_command(m: Any) -> Row:
    wrenches = (*_vector(m.force), *_vector(m.torque), *_vector(m.wanted_force), *_vector(m.wanted_torque), m.energy_j)
    return (*wrenches, m.faults, m.passivity_active, _choice(m, "drive"), _choice(m, "off_cause").lower().replace("_", "-"))


def _of_rendered(m: Any) -> Row:
    return (*_vector(m.force), *_vector(m.torque))


def _of_fault(m: Any) -> Row:
    return (m.message,)


def _of_scene(m: Any) -> Row:
    return (m,)


ROWS: dict[str, tuple[Callable[[Any], Row], int, int]] = {
    TIMING: (_of_timing, 6, 0),
    DEVICE: (_of_device, 16, 2),
    TOOL: (_of_tool, 7, 0),
    OBJECTS: (_of_object, 8, 0),
    CONTACT: (_of_contact, 11, 0),
    COMMAND: (_of_command, 15, 2),
    RENDERED: (_of_rendered, 6, 0),
    FAULTS: (_of_fault, 0, 1),
    SCENE: (_of_scene, 0, 1),
}
"""What is kept of a message of each channel: numbers, then words or whole messages, and how many there are of both."""


class Table:
    """Rows of a channel: numbers (whole ones below 2⁵³) and words, packed, as a long recording has millions."""

    def __init__(self, n_numbers: int, n_words: int) -> None:
        self._n_numbers, self._n_words = n_numbers, n_words
        self._numbers = array("d")
        self._words: list[Any] = []
        self._ticks = array("q")

    def add(self, tick: int, row: Row) -> None:
        """Adds what one message holds."""
        self._numbers.extend(row[: self._n_numbers])
        self._words.extend(row[self._n_numbers :])
        self._ticks.append(tick)

    def cut(self, n_rows: int) -> None:
        """Leaves so many rows, if there are more."""
        del self._numbers[n_rows * self._n_numbers :]
        del self._words[n_rows * self._n_words :]
        del self._ticks[n_rows:]

    def ticks(self) -> Ints:
        """Number of the tick of each row, its lowest 32 bits."""
        return np.array(self._ticks, dtype=np.int64)

    def floats(self, begin: int, width: int) -> Floats:
        """Some columns side by side, (n, width)."""
        return np.array(self._columns()[:, begin : begin + width])

    def float(self, column: int) -> Floats:
        """One column, (n,)."""
        return np.array(self._columns()[:, column])

    def seconds(self, column: int) -> Floats:
        """A column of nanoseconds."""
        return self.float(column) * 1e-9

    def ints(self, column: int) -> Ints:
        """One column of whole numbers."""
        return self._columns()[:, column].astype(np.int64)

    def bools(self, column: int) -> Bools:
        """One column of yes and no."""
        return self._columns()[:, column].astype(np.bool_)

    def words(self, column: int) -> Words:
        """One column of words."""
        return np.array(self._words[column :: self._n_words], dtype=np.str_)

    def messages(self) -> list[Any]:
        """The messages of a channel that are kept whole."""
        return self._words

    def _columns(self) -> Floats:
        return np.frombuffer(self._numbers, dtype=np.float64).reshape(-1, self._n_numbers)


class Records:
    """Records of a file in the order in which they were written."""

    def __init__(self, path: Path, wanted: set[str]) -> None:
        self.path, self.wanted = path, wanted
        self.tables = {topic: Table(*counts) for topic, (_, *counts) in ROWS.items()}
        self.run: dict[str, str] | None = None
        self.end: dict[str, str] | None = None
        self.zero_ns: int | None = None
        """Time of the messages at loop time zero, ns."""
        self.scenes: dict[str, dict[str, str]] = {}
        self.attachments: dict[str, bytes] = {}
        self.is_whole = False
        self._schemas: dict[int, Schema] = {}
        self._readers: dict[int, tuple[str, Callable[[bytes], Any]]] = {}
        self._decoders = DecoderFactory()

    def file(self) -> None:
        """Reads the file, as far as it goes. Raises RecordingError where it does not even begin as one."""
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
                    keep, *_ = ROWS[topic]
                    message = decode(record.data)
                    self.tables[topic].add(record.sequence, keep(message))
                    if topic == TIMING and self.zero_ns is None:
                        self.zero_ns = record.log_time - message.time_ns
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
