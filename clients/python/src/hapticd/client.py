"""The client: one connection to a run. Plain calls that return when they are done, from any thread; no event loop is needed."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Generator
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapticd.clay import Clay
from hapticd.connection import Address, Connection, Every, Stream
from hapticd.errors import Disconnected, Invalid, NoAnswer, Unavailable
from hapticd.facts import ClientRecording, Event, Mesh, Parameter, Scene, SceneObject
from hapticd.hand import Hand
from hapticd.state import State, decode

LOOKS_HZ = 20.0
"""How often `wait_until` looks: well below what the server lets one machine ask for."""


class Client:
    """A connection to `hapticd run` or `hapticd sculpt`.

    Without a heartbeat the arm goes on as it was when this client ends. With one (`heartbeat_ms`, `heartbeat`) force goes off when it ends or hangs.
    """

    clay: Clay
    """What is done to clay, where there is some."""
    hand: Hand
    """What moves the hand of a simulated arm."""

    def __init__(
        self,
        address: str = "http://127.0.0.1:7878",
        *,
        token: str | None = None,
        heartbeat_ms: float | None = None,
        timeout_s: float = 30.0,
    ) -> None:
        """Connects. `address` is what `hapticd run` prints (`monitor: http://…`), `HOST:PORT`, or the page's address with `#token=…`.

        `token`: where the server wants one; else that of the environment variable `HAPTICD_TOKEN`. `timeout_s`: how long a call waits for its answer
        before it raises `NoAnswer`. Raises `Disconnected` where no daemon listens, and `Forbidden` without the right token.
        """
        self._connection = Connection(Address.parse(address, token or os.environ.get("HAPTICD_TOKEN")), timeout_s)
        self._heart: Every | None = None
        self.clay = Clay(self._connection)
        self.hand = Hand(self._connection)
        if heartbeat_ms is not None:
            try:
                self.heartbeat(heartbeat_ms)
            except BaseException:
                self.close()
                raise

    def __enter__(self) -> Client:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Ends the connection. A heartbeat that was not ended (`end_heartbeat`) counts as silence: force goes off."""
        if self._heart is not None:
            self._heart.stop()
            self._heart = None
        self.clay.close()
        self._connection.close()

    @property
    def version(self) -> str:
        """Version of the server."""
        return str(self._connection.hello["version"])

    def info(self) -> dict[str, Any]:
        """What the run says of itself: program, clock, rate, arm, limits, what the machine lacks (`GET /api/v1/info` in `docs/reference/api.md`)."""
        said: dict[str, Any] = self._connection.json("/api/v1/info")
        return said

    # Force

    def enable(self) -> None:
        """Lets force rise from zero, and acknowledges a fault. Returns when the order is given: `wait_until(lambda s: s.phase == "enabled")`."""
        self._connection.ask("enable")

    def disable(self) -> None:
        """No force, at once."""
        self._connection.ask("disable")

    def stop(self) -> None:
        """Ramps the force down and ends the run."""
        self._connection.ask("stop")

    def heartbeat(self, timeout_ms: float = 500.0) -> None:
        """From now on force goes off when this client says nothing for so long, 20 to 10,000 ms.

        A thread says something three times as often. It shows that this process lives, not that your code goes on: a loop of yours that has to prove
        that it does should rather call `beat` itself, each time round. Raises `Invalid` for a time that the server does not accept.
        """
        self.beat(timeout_ms)
        if self._heart is not None:
            self._heart.stop()
        self._heart = Every(timeout_ms / 3000.0, lambda: self._connection.tell("heartbeat", timeout_ms=timeout_ms))

    def beat(self, timeout_ms: float) -> None:
        """One sign of life, by hand: force goes off unless the next one comes within `timeout_ms`."""
        self._connection.ask("heartbeat", {"timeout_ms": timeout_ms})

    def end_heartbeat(self) -> None:
        """Takes leave: force goes on as it is, without this client."""
        if self._heart is not None:
            self._heart.stop()
            self._heart = None
        self._connection.ask("heartbeat", {"timeout_ms": 0})

    # States and events

    def state(self) -> State:
        """The newest state, by a request of its own. Raises `Unavailable` before the first tick."""
        return State.from_json(self._connection.json("/api/v1/state"))

    def states(self, rate_hz: float = 60.0, *, contacts: bool = False, history: bool = False, backlog: int = 1) -> Generator[State, None, None]:
        """States at this rate (0.1 to 1000 Hz) until the run ends, or another stream of this client begins.

        A reader that is slow gets the newest and skips the others (`seq` shows it); `backlog` keeps so many for it. `contacts` asks for contact points,
        `history` for what happened between two states. Raises `Invalid` for a rate that the server does not accept.
        """
        stream = Stream(is_binary=False, backlog=backlog)
        try:
            self._connection.ask("subscribe", {"rate_hz": rate_hz, "contacts": contacts, "history": history}, stream=stream)
            while (said := stream.take()) is not None:
                yield State.from_json(said)
        finally:
            self._leave(stream)

    def capture(self, duration_s: float, rate_hz: float = 1000.0, *, timeout_s: float | None = None) -> NDArray[np.void]:
        """States over a stretch of loop time as an array of `STATE_DTYPE`: `rows["servo_cf"]["f"]` are forces (N), one row each.

        At 1000 Hz and a loop of 1 kHz every tick comes, or is counted in `dropped`. Fewer rows come where the run ends first. Raises `NoAnswer` after
        `timeout_s` of the wall clock [default: the duration and `timeout_s` of the client], and `Invalid` for a rate that the server does not accept and
        for a run in simulated time (`clock="virtual"`): its seconds pass in milliseconds, so that a rate of the wall clock would give a few rows of them.
        """
        if self.info().get("clock") == "virtual":
            raise Invalid(
                400,
                "the run is in simulated time, whose seconds pass faster than states are sent: `capture` would leave most ticks out",
                "`record` and `end_recording` write every tick into a file for `hapticd.recordings.load`; `states` shows some",
            )
        stream = Stream(is_binary=True, backlog=None)
        messages: list[bytes] = []
        begin_ns: int | None = None
        try:
            self._connection.ask("subscribe", {"rate_hz": rate_hz, "format": "binary"}, stream=stream)
            deadline_s = time.monotonic() + (duration_s + self._connection.timeout_s if timeout_s is None else timeout_s)
            while (message := stream.take(deadline_s)) is not None:
                messages.append(message)
                time_ns = int.from_bytes(message[16:24], "little", signed=True)
                begin_ns = time_ns if begin_ns is None else begin_ns
                if time_ns - begin_ns >= duration_s * 1e9:
                    break
        finally:
            self._leave(stream)
        return decode(messages)

    def wait_until(self, condition: Callable[[State], bool], timeout_s: float | None = None) -> State:
        """The first state for which the condition holds, looked at twenty times a second, beside any stream; also while the scene is being baked.

        Raises `NoAnswer` after `timeout_s`."""
        deadline_s = time.monotonic() + (self._connection.timeout_s if timeout_s is None else timeout_s)
        stands = "the scene is being baked"
        while True:
            try:
                state = self.state()
                if condition(state):
                    return state
                stands = f"the run is {state.phase}, {state.time_s:.3f} s after its begin"
            except Unavailable:
                pass
            if time.monotonic() > deadline_s:
                raise NoAnswer(f"what was waited for did not come: {stands}")
            time.sleep(1.0 / LOOKS_HZ)

    def events(self) -> list[Event]:
        """Events that have come since the last call, at most the last thousand."""
        connection = self._connection
        with connection.happened:
            taken = list(connection.events)
            connection.events.clear()
        return taken

    def wait_for(self, event: str, *names: str, timeout_s: float | None = None) -> Event:
        """The next event of this kind that has all these names; those before it are passed over. Raises `NoAnswer` after `timeout_s`."""
        connection = self._connection
        wait_s = connection.timeout_s if timeout_s is None else timeout_s
        deadline_s = time.monotonic() + wait_s
        with connection.happened:
            while True:
                while connection.events:
                    one = connection.events.popleft()
                    if one.event == event and set(names) <= set(one.names):
                        return one
                if (why := connection.why_ended()) is not None:
                    raise Disconnected(why)
                if (left_s := deadline_s - time.monotonic()) <= 0:
                    raise NoAnswer(f"no event `{' '.join((event, *names))}` within {wait_s:g} s")
                connection.happened.wait(left_s)

    # The scene

    def scene(self) -> Scene:
        """The scene that is rendered. Raises `Unavailable` while the first one is baked."""
        return Scene.from_json(self._connection.json("/api/v1/scene"))

    def scenes(self) -> list[str]:
        """Names of the scenes that `switch` takes: those in the folder of the present one."""
        return list(self._connection.json("/api/v1/scenes"))

    def switch(self, scene: str, timeout_s: float = 600.0) -> None:
        """Changes to another scene for the same arm: baked while the present one renders, then exchanged at zero force. Returns when it is baked."""
        self._connection.ask("switch", {"scene": scene}, timeout_s=timeout_s)

    def mesh(self, scene_object: SceneObject) -> Mesh:
        """The triangles of an object, for display. Raises LookupError for one without."""
        if scene_object.mesh is None:
            raise LookupError(f"`{scene_object.name}` has no mesh")
        return Mesh.from_bytes(self._connection.address.get(scene_object.mesh, self._connection.timeout_s) or b"")

    def place(self, name: str, position_m: ArrayLike, orientation_xyzw: ArrayLike = (0.0, 0.0, 0.0, 1.0)) -> None:
        """Wishes a movable object to a pose in the world. It follows within its limits of speed; 60 wishes a second are plenty.

        Raises `Unknown` where no object of the scene has this name, with the names of those that may be moved.
        """
        pose = {"p": _floats(position_m), "q": _floats(orientation_xyzw)}
        self._connection.ask("place", {"object": name, "pose": pose})

    def reset(self, timeout_s: float = 600.0) -> None:
        """The scene as it was at its beginning: tool and objects where they began, parameters as in its file. Raises `Conflict` for clay."""
        self._connection.ask("reset", timeout_s=timeout_s)

    def parameters(self) -> dict[str, Parameter]:
        """What may be changed while the run goes on, by name, with its range."""
        said = self._connection.json("/api/v1/parameters")
        return {parameter.name: parameter for parameter in map(Parameter.from_json, said)}

    def get(self, parameter: str) -> float:
        """Where a parameter is, or goes to, SI. Raises LookupError for one that is not there."""
        parameters = self.parameters()
        if parameter not in parameters:
            raise LookupError(f"no parameter of this scene is called `{parameter}`; known here: {', '.join(parameters)}")
        return parameters[parameter].value

    def set(self, parameter: str, value: float) -> None:
        """Sets a parameter, SI. It goes there along a line, through its whole range in half a second of the loop.

        Raises `Invalid` (a ValueError) for a value out of its range and `Unknown` (a LookupError) for a name that is not there, in the server's words.
        """
        self._connection.ask("set", {"parameter": parameter, "value": float(value)})

    # Recordings

    def record(self, file: str | None = None) -> ClientRecording:
        """Begins a recording of every tick on the machine of the run, with a name of its choice or this one; `hapticd.recordings.load` reads it."""
        return ClientRecording.from_json(self._connection.ask("record", {} if file is None else {"file": file})["recording"])

    def end_recording(self) -> ClientRecording:
        """Ends it. Raises `Conflict` where there is none."""
        return ClientRecording.from_json(self._connection.ask("end_recording")["recording"])

    def _leave(self, stream: Stream) -> None:
        try:
            self._connection.leave(stream)
        except Disconnected:
            pass


def _floats(numbers: ArrayLike) -> list[float]:
    listed: list[float] = np.asarray(numbers, dtype=np.float64).tolist()
    return listed
