"""Recordings (`hapticd run --record FILE.mcap`) for the Rerun viewer. Needs the extra `hapticd[rerun]` and Python 3.11.

    python -m hapticd.rerun session.mcap session.rrd
    rerun session.rrd

The file holds the parts, the tool, the contact and the commanded wrench as arrows, all of them as curves, what happened as a log, and the arrangement of
these views. Timelines: `time` since the loop began, `tick`, and `wall_clock` unless the clock was virtual. Clay is not in a recording.

Arrows begin at the middle of the tool (a GLB: at the origin of its file) and are in world axes. An arrow for 1 N is as long as 10 mm of the arm, one for
10 mN·m too, multiplied by the scene's `device.world_from_device.scale`; the title of the 3-D view says how many newtons a metre is.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

try:
    import rerun as rr
    import rerun.blueprint as rrb

    from hapticd.recordings import RecordedScene, Recording, RecordingError, load
    from hapticd.records import Floats, Ints
except ImportError as missing:
    NEEDED = f"hapticd.rerun needs the packages rerun-sdk, mcap and mcap-protobuf-support: pip install 'hapticd[rerun]' ({missing})"
    if __name__ == "__main__":
        sys.exit(f"error: {NEEDED}")
    raise ImportError(NEEDED) from missing

__all__ = ["NEWTONS_PER_METRE", "Converted", "RecordingError", "convert"]

NEWTONS_PER_METRE = 100.0
"""Force of an arrow that is one metre long at the arm, unless told otherwise."""
METRES_OF_LEVER = 0.01
"""Torque of an arrow, N·m, for each newton of an arrow of the same length."""
AXES_COLORS = [[220, 60, 60], [70, 170, 70], [70, 110, 230]]
CONTACT_COLOR, COMMAND_COLOR = [230, 60, 50], [60, 120, 240]
"""What the parts do to the tool, and what the arm is told."""
OPACITY = 0.45
CORNERS = 48
"""Of the circle that stands for the end of a cylinder."""


@dataclass(frozen=True, slots=True)
class Converted:
    """What was written."""

    path: Path
    """The file."""
    ticks: int
    """Ticks in it."""
    newtons_per_metre: float
    """Force of an arrow of one metre, in the first scene."""
    notes: tuple[str, ...]
    """What is missing from it, in sentences."""


def convert(recording: str | Path, out: str | Path, *, overwrite: bool = False, newtons_per_metre: float = NEWTONS_PER_METRE) -> Converted:
    """Writes a recording as a file of Rerun: `out` appears when it is whole. A file that was cut off is written up to the cut.

    Raises `RecordingError` for what is no recording of hapticd, FileExistsError where `out` is there and `overwrite` is not given, and OSError where a file
    cannot be read or written.
    """
    recording, out = Path(recording), Path(out)
    if not 0 < newtons_per_metre < np.inf:
        raise ValueError(f"newtons_per_metre is above 0, not {newtons_per_metre}")
    if out.exists() and not overwrite:
        raise FileExistsError(f"{out}: exists already: name another file, or overwrite it")
    if not out.parent.is_dir():
        raise FileNotFoundError(f"{out.parent}: there is no such folder")
    loaded = load(recording)
    part = out.with_name(f".{out.name}.{os.getpid()}.part")
    try:
        # Rerun says what the disk says in its log alone: a file that cannot be created is found here, one that was not written whole below.
        part.touch()
        log = _Log(loaded, newtons_per_metre)
        try:
            log.write(part)
            is_whole = _is_whole(part)
        except RuntimeError:
            is_whole = False
        if not is_whole:
            raise OSError(f"{out}: could not be written whole, is the disk full?")
        os.replace(part, out)
    finally:
        part.unlink(missing_ok=True)
    return Converted(out, len(loaded), log.newtons_per_metre(0), tuple(log.notes))


def _is_whole(path: Path) -> bool:
    """Rerun ends a file with an index; a file that was not written to its end has none."""
    try:
        with open(path, "rb") as file:
            file.seek(-64, os.SEEK_END)
            return b"RRF2FOOT" in file.read()
    except OSError:
        return False


class _Log:
    """A recording on its way into Rerun."""

    def __init__(self, recording: Recording, newtons_per_metre: float) -> None:
        self.notes: list[str] = []
        self._recording, self._newtons_per_metre = recording, newtons_per_metre
        self._timing = recording.timing
        self._time_ns = np.rint(self._timing.time_s * 1e9).astype(np.int64)
        self._stream = rr.RecordingStream("hapticd", send_properties=True)
        self._stream.set_log_time_enabled(False)
        self._stream.set_log_tick_enabled(False)
        # Of each tick: where the tool's middle is in its own frame, how the arm's axes stand in the world, how many newtons an arrow of a metre is.
        n = len(recording)
        self._middle_m = np.zeros((n, 3))
        self._world_from_device = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))
        self._scale = np.ones((n, 1))
        for idx, scene in self._scenes():
            rows = self._timing.scene_idx == idx
            port = scene.resolved["parameters"]["port"]
            self._world_from_device[rows] = port["world_from_device"]["orientation_xyzw"]
            self._scale[rows] = port["scale"]

    def newtons_per_metre(self, row: int) -> float:
        """Force of an arrow of one metre in the scene of that row."""
        return float(self._newtons_per_metre / self._scale[row, 0])

    def write(self, path: Path) -> None:
        """Writes everything."""
        self._stream.save(path, default_blueprint=self._blueprint())
        self._stream.send_recording_name(self._recording.path.stem)
        self._what_is_missing()
        self._static("/world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        self._parts()
        self._tool()
        self._arrows()
        self._curves()
        self._events()
        self._stream.flush()
        self._stream.disconnect()

    def _what_is_missing(self) -> None:
        recording = self._recording
        if not recording.is_whole:
            self.notes.append(f"{recording.path} has no end, it was cut off: its {len(recording)} whole ticks were converted")
        if recording.dropped:
            self.notes.append(f"the recorder dropped {recording.dropped} ticks")
        if any(re.search(r"^\s*\[sculpt\b", scene.toml, re.M) for scene in recording.scenes):
            self.notes.append("the surface of clay is not in a recording")

    def _scenes(self) -> Iterator[tuple[int, RecordedScene]]:
        """The scenes with their numbers: a recording that a client began may begin with a later one than 0."""
        numbers = np.unique(self._timing.scene_idx)
        return zip((int(idx) for idx in numbers), self._recording.scenes)

    def _rows(self, ticks: Ints) -> Ints:
        """Rows of ticks of which the lowest 32 bits are known; -1 where there is no such row."""
        every = self._timing.tick
        ticks = every[0] + ((ticks - every[0]) & 0xFFFF_FFFF)
        rows = np.minimum(np.searchsorted(every, ticks), len(every) - 1)
        return np.where(every[rows] == ticks, rows, -1)

    def _times(self, rows: slice | Ints = slice(None)) -> list[Any]:
        times_ns = self._time_ns[rows]
        times = [rr.TimeColumn("time", duration=times_ns.astype("timedelta64[ns]")), rr.TimeColumn("tick", sequence=self._timing.tick[rows])]
        if (began_ns := self._recording.began_ns) is not None:
            times.append(rr.TimeColumn("wall_clock", timestamp=(began_ns + times_ns).astype("datetime64[ns]")))
        return times

    def _columns(self, path: str, columns: Any, rows: slice | Ints = slice(None)) -> None:
        self._stream.send_columns(path, self._times(rows), columns)

    def _static(self, path: str, what: Any) -> None:
        self._stream.log(path, what, static=True)

    def _at(self, row: int) -> None:
        """What is logged next is of the tick of this row."""
        time_ns = int(self._time_ns[row])
        self._stream.set_time("time", duration=np.timedelta64(time_ns, "ns"))
        self._stream.set_time("tick", sequence=int(self._timing.tick[row]))
        if (began_ns := self._recording.began_ns) is not None:
            self._stream.set_time("wall_clock", timestamp=np.datetime64(began_ns + time_ns, "ns"))

    def _parts(self) -> None:
        """Parts where they stand, the tool's shape under the tool; those of another scene before are cleared."""
        shown_rows = self._rows(np.array([shown.tick for shown in self._recording.shown], dtype=np.int64))
        scenes = dict(self._scenes())
        before: int | None = None
        for row, shown in zip(shown_rows.tolist(), self._recording.shown):
            if row < 0:
                continue
            self._at(row)
            idx = int(self._timing.scene_idx[row])
            if before is not None:
                for folder in (_folder(before), f"/world/tool/{before}"):
                    self._stream.log(folder, rr.Clear(recursive=True))
            before = idx
            statics = scenes[idx].resolved["statics"] if idx in scenes else []
            poses = {part["name"]: part["pose"] for part in statics}
            for entity in shown.update.entities:
                pose = poses.get(entity.id, {"position_m": [0, 0, 0], "orientation_xyzw": [0, 0, 0, 1]})
                position, orientation = np.array(pose["position_m"], float), np.array(pose["orientation_xyzw"], float)
                if entity.frame_id == "tool":
                    path = f"/world/tool/{idx}"
                    self._middle_m[self._timing.scene_idx == idx] = _middle(entity)
                else:
                    path = _part(idx, entity.id)
                    self._stream.log(path, rr.Transform3D(translation=position, quaternion=orientation))
                shapes = list(_shapes(entity))
                if not shapes:
                    self.notes.append(f"the shape of `{entity.id}` is not in the recording")
                for shape_pose, scale, shape in shapes:
                    # Their poses are in the world, where the part stands at first; the part may move from there.
                    where = _rotated(_conjugate(orientation), _position(shape_pose) - position)
                    turned = _product(_conjugate(orientation), _orientation(shape_pose))
                    self._stream.log(f"{path}/shape", rr.Transform3D(translation=where, quaternion=turned, scale=scale), shape)
        self._moving(scenes)

    def _moving(self, scenes: dict[int, RecordedScene]) -> None:
        objects = self._recording.objects
        rows = self._rows(objects.tick)
        scene_idx = np.where(rows < 0, -1, self._timing.scene_idx[rows])
        for idx, scene in scenes.items():
            for object_idx, part in enumerate(scene.resolved["statics"]):
                of_part = (scene_idx == idx) & (objects.object_idx == object_idx)
                if of_part.any():
                    poses = rr.Transform3D.columns(translation=objects.position_m[of_part], quaternion=objects.orientation_xyzw[of_part])
                    self._columns(_part(idx, part["name"]), poses, rows[of_part])

    def _tool(self) -> None:
        tool, device = self._recording.tool, self._recording.device
        self._columns("/world/tool", rr.Transform3D.columns(translation=tool.position_m, quaternion=tool.orientation_xyzw))
        self._columns("/device/grip", rr.Transform3D.columns(translation=device.position_m, quaternion=device.orientation_xyzw))

    def _arrows(self) -> None:
        contact, command, tool = self._recording.contact, self._recording.command, self._recording.tool
        origins = tool.position_m + _rotated(tool.orientation_xyzw, self._middle_m)
        forces = {
            "contact": (contact.force_n, contact.torque_nm, CONTACT_COLOR),
            "command": (_rotated(self._world_from_device, command.force_n), _rotated(self._world_from_device, command.torque_nm), COMMAND_COLOR),
        }
        metres_per_newton = self._scale / self._newtons_per_metre
        for name, (force_n, torque_nm, color) in forces.items():
            for kind, vectors_n, width in (("force", force_n, 2.5), ("torque", torque_nm / METRES_OF_LEVER, 1.2)):
                path = f"/world/{name}_{kind}"
                self._static(path, rr.Arrows3D.from_fields(colors=[color], radii=[rr.Radius.ui_points(width)]))
                self._columns(path, rr.Arrows3D.columns(vectors=vectors_n * metres_per_newton, origins=origins))

    def _curves(self) -> None:
        recording, timing = self._recording, self._timing
        xyz = ("x", "y", "z")
        for name, wrench in (("contact", recording.contact), ("command", recording.command), ("rendered", recording.rendered)):
            self._curve(f"/wrench/{name}/force_n", wrench.force_n, xyz)
            self._curve(f"/wrench/{name}/torque_nm", wrench.torque_nm, xyz)
        self._curve("/wrench/contact/max_depth_mm", recording.contact.max_depth_m * 1e3, ("deepest point",))
        self._curve("/wrench/contact/clearance_mm", recording.contact.clearance_m * 1e3, ("clearance",))
        self._curve("/wrench/contact/contacts", recording.contact.contacts.astype(np.float64), ("points in contact",))
        self._curve("/device/position_mm", recording.device.position_m * 1e3, xyz)
        parts_us = np.column_stack([timing.compute_s, timing.device_s, timing.wakeup_s]) * 1e6
        self._curve("/loop/timing_us", parts_us, ("tick", "driver", "lateness"))

    def _curve(self, path: str, values: Floats, names: Sequence[str]) -> None:
        colors = AXES_COLORS[: len(names)] if len(names) > 1 else [COMMAND_COLOR]
        self._static(path, rr.SeriesLines(names=names, colors=colors))
        columns = rr.Scalars.columns(scalars=values.reshape(-1)).partition(np.full(len(self._recording), len(names)))
        self._columns(path, columns)

    def _events(self) -> None:
        """What happened, in turn: scenes, drive, faults, and ticks that are missing."""
        recording, timing = self._recording, self._timing
        names = {idx: scene.name for idx, scene in self._scenes()}
        events: list[tuple[int, str, str]] = []
        for row in _changes(timing.scene_idx):
            events.append((row, "INFO", f"scene: {names.get(int(timing.scene_idx[row]), timing.scene_idx[row])}"))
        drive, cause = recording.command.drive, recording.command.off_cause
        for row in _changes(drive):
            why = "" if cause[row] == "none" else f" ({cause[row]})"
            events.append((row, "ERROR" if drive[row] == "FAULT" else "INFO", f"drive: {str(drive[row]).lower()}{why}"))
        fault_rows = self._rows(np.array([fault.tick for fault in recording.faults], dtype=np.int64)).tolist()
        bits = recording.command.faults
        events += [(row, "ERROR" if bits[row] else "INFO", fault.text) for row, fault in zip(fault_rows, recording.faults) if row >= 0]
        steps = np.diff(timing.tick)
        events += [(row + 1, "WARN", f"{steps[row] - 1} ticks are missing before this one") for row in np.nonzero(steps > 1)[0].tolist()]
        events.sort(key=lambda event: event[0])
        rows, levels, texts = zip(*events)
        self._columns("/events", rr.TextLog.columns(text=texts, level=levels), np.array(rows))

    def _blueprint(self) -> Any:
        newtons = self.newtons_per_metre(0)
        scene = f"scene (arrows: red contact, blue command; 1 m is {newtons:g} N, thin ones {newtons * METRES_OF_LEVER:g} N·m)"
        plots = {
            "contact force, N, world axes": "/wrench/contact/force_n",
            "contact torque, N·m, world axes": "/wrench/contact/torque_nm",
            "commanded force, N, device axes": "/wrench/command/force_n",
            "commanded torque, N·m, device axes": "/wrench/command/torque_nm",
            "depth, mm": "/wrench/contact/max_depth_mm",
            "points in contact": "/wrench/contact/contacts",
            "grip, mm, device axes": "/device/position_mm",
            "duration of ticks, µs": "/loop/timing_us",
        }
        views = [rrb.TimeSeriesView(origin=origin, name=name) for name, origin in plots.items()]
        left = rrb.Vertical(
            rrb.Spatial3DView(origin="/world", name=scene), rrb.TextLogView(origin="/events", name="events"), row_shares=[4, 1]
        )
        return rrb.Blueprint(
            rrb.Horizontal(left, rrb.Grid(*views, grid_columns=2), column_shares=[1, 1]),
            rrb.TimePanel(timeline="time", state="collapsed"),
            rrb.SelectionPanel(state="collapsed"),
            rrb.BlueprintPanel(state="collapsed"),
        )


def _folder(scene_idx: int) -> str:
    return f"/world/parts/{scene_idx}"


def _part(scene_idx: int, name: str) -> str:
    return f"{_folder(scene_idx)}/{rr.escape_entity_path_part(name)}"


def _changes(values: NDArray[Any]) -> list[int]:
    """Rows that differ from the one before, and the first."""
    return [0, *(np.nonzero(values[1:] != values[:-1])[0] + 1).tolist()]


def _position(pose: Any) -> Floats:
    return np.array([pose.position.x, pose.position.y, pose.position.z])


def _orientation(pose: Any) -> Floats:
    q = pose.orientation
    return np.array([q.x, q.y, q.z, q.w])


def _rotated(quaternions: Floats, vectors: Floats) -> Floats:
    """Vectors turned by unit quaternions, x, y, z, w."""
    axis, w = quaternions[..., :3], quaternions[..., 3:]
    across = 2 * np.cross(axis, vectors)
    return np.asarray(vectors + w * across + np.cross(axis, across))


def _conjugate(quaternion: Floats) -> Floats:
    return quaternion * [-1, -1, -1, 1]


def _product(a: Floats, b: Floats) -> Floats:
    return np.array([*(a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3])), a[3] * b[3] - a[:3] @ b[:3]])


def _shapes(entity: Any) -> Iterator[tuple[Any, Floats, Any]]:
    """Pose, scale and shape of each primitive of a `foxglove.SceneEntity`."""
    one = np.ones(3)
    for cube in entity.cubes:
        yield cube.pose, one, rr.Boxes3D(half_sizes=[_size(cube.size) / 2], colors=[_color(cube)], fill_mode="solid")
    for sphere in entity.spheres:
        yield sphere.pose, one, rr.Ellipsoids3D(half_sizes=[_size(sphere.size) / 2], colors=[_color(sphere)], fill_mode="solid")
    for cylinder in entity.cylinders:
        yield cylinder.pose, _size(cylinder.size), _cylinder(cylinder)
    for model in entity.models:
        asset = rr.Asset3D(contents=model.data, media_type=model.media_type, albedo_factor=_color(model))
        yield model.pose, _size(model.scale), asset


def _size(vector: Any) -> Floats:
    return np.array([vector.x, vector.y, vector.z])


def _color(primitive: Any) -> list[int]:
    """Its color, so transparent that arrows inside it are seen."""
    color = primitive.color
    return [round(255 * share) for share in (color.r, color.g, color.b, OPACITY * color.a)]


def _cylinder(cylinder: Any) -> Any:
    """A cylinder or cone of size 1 along z, around the origin."""
    angles = np.arange(CORNERS) * (2 * np.pi / CORNERS)
    circle = 0.5 * np.column_stack([np.cos(angles), np.sin(angles)])
    ends = [np.column_stack([circle * scale, np.full(CORNERS, z)]) for scale, z in ((cylinder.bottom_scale, -0.5), (cylinder.top_scale, 0.5))]
    here = np.arange(CORNERS)
    after = (here + 1) % CORNERS
    bottom, top = np.full(CORNERS, 2 * CORNERS), np.full(CORNERS, 2 * CORNERS + 1)
    triangles = [(here, after, here + CORNERS), (after, after + CORNERS, here + CORNERS), (bottom, after, here), (top, here + CORNERS, after + CORNERS)]
    vertices = np.vstack([*ends, [[0, 0, -0.5], [0, 0, 0.5]]])
    return rr.Mesh3D(vertex_positions=vertices, triangle_indices=np.vstack([np.column_stack(t) for t in triangles]), albedo_factor=_color(cylinder))


def _middle(entity: Any) -> Floats:
    """Middle of the shape of an entity in its frame, m."""
    for model in entity.models:
        vertices = _vertices(model.media_type, model.data)
        middle = np.zeros(3) if vertices is None else (vertices.min(axis=0) + vertices.max(axis=0)) / 2
        return _position(model.pose) + _rotated(_orientation(model.pose), _size(model.scale) * middle)
    for primitive in (*entity.cubes, *entity.spheres, *entity.cylinders):
        return _position(primitive.pose)
    return np.zeros(3)


def _vertices(media_type: str, data: bytes) -> Floats | None:
    """Vertices of a mesh file, in its units; None for other formats than OBJ and STL."""
    if media_type == "model/stl":
        n = int.from_bytes(data[80:84], "little")
        if len(data) == 84 + 50 * n:
            corners = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
            found = np.frombuffer(data, corners, n, 84)["corners"].reshape(-1, 3).astype(np.float64)
            return found if n else None
    if media_type not in ("model/stl", "model/obj"):
        return None
    word = b"vertex" if media_type == "model/stl" else b"v"
    rows = [words[1:4] for line in data.splitlines() if (words := line.split()) and words[0] == word]
    return np.array(rows, dtype=np.float64) if rows else None


def main() -> int:
    """Command line: `python -m hapticd.rerun`."""
    parser = argparse.ArgumentParser(prog="python -m hapticd.rerun", description="Converts a recording of hapticd into a file of the Rerun viewer.")
    parser.add_argument("recording", type=Path, metavar="RECORDING.mcap", help="what `hapticd run --record` wrote")
    parser.add_argument("out", type=Path, metavar="OUT.rrd", help="file to write, for `rerun OUT.rrd`")
    parser.add_argument("--overwrite", action="store_true", help="write over OUT.rrd if it is there already")
    parser.add_argument(
        "--newtons-per-metre",
        type=float,
        default=NEWTONS_PER_METRE,
        metavar="N",
        help="force of an arrow that is one metre long at the arm [default: %(default)g]; a torque arrow of that length has a hundredth of it in N·m",
    )
    args = parser.parse_args()
    try:
        converted = convert(args.recording, args.out, overwrite=args.overwrite, newtons_per_metre=args.newtons_per_metre)
    except FileExistsError as error:
        print(f"error: {error} (--overwrite)", file=sys.stderr)
        return 2
    except (RecordingError, ValueError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    for note in converted.notes:
        print(f"note: {note}", file=sys.stderr)
    print(f"{converted.path}: {converted.ticks} ticks; show it with `rerun {converted.path}`")
    return 0


if __name__ == "__main__":
    sys.exit(main())
