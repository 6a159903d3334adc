"""A client of hapticd's WebSocket API (docs/api.md), small enough to be read.

    async with Client("ws://127.0.0.1:7878") as arm:
        await arm.ask("enable")
        async for state in arm.states(rate_hz=60):
            print(state["servo_cf"]["f"])

SI throughout: metres, newtons, seconds; orientations are quaternions x, y, z, w. Clients send poses and parameters, never forces.
"""

import asyncio
import collections
import contextlib
import itertools
import json
import urllib.error
import urllib.request

import websockets

# While clay is held a sign of life goes out this often; it is let go after a second of silence.
HOLD_BEAT_S = 0.2


class Refused(Exception):
    """The server did not do what it was asked for; says why, and what would do."""


class Client:
    """One connection. Replies are matched to what was asked; of states that nobody has taken yet only the newest is kept, of events the last thousand."""

    def __init__(self, url, token=None, heartbeat_ms=None):
        """`url` is that of the page (`http://…`) or `ws://…`. With `heartbeat_ms` the arm is disabled when this client falls silent."""
        self._root = url.replace("ws", "http", 1).rstrip("/").removesuffix("/api/v1/ws") + "/api/v1/"
        self._url = url.replace("http", "ws", 1).rstrip("/").removesuffix("/api/v1/ws") + "/api/v1/ws"
        self._headers = {"Authorization": f"Bearer {token}"} if token else {}
        self._heartbeat_ms = heartbeat_ms
        self._ids = itertools.count(1)
        self._replies = {}
        self._states = asyncio.Queue(maxsize=1)
        self._tasks = []
        self.hello = None
        self.events = collections.deque(maxlen=1000)

    async def __aenter__(self):
        try:
            self._socket = await websockets.connect(self._url, additional_headers=self._headers)
        except websockets.InvalidStatus as refused:
            said = json.loads(refused.response.body or "{}")
            raise Refused(said.get("error", f"the server answered {refused.response.status_code}")) from None
        self.hello = json.loads(await self._socket.recv())
        if self.hello.get("api") != 1:
            raise Refused(f"this client speaks version 1 of the API, the server {self.hello.get('api')}")
        self._tasks.append(asyncio.create_task(self._listen()))
        if self._heartbeat_ms:
            await self.ask("heartbeat", timeout_ms=self._heartbeat_ms)
            self._tasks.append(asyncio.create_task(self._beat()))
        return self

    async def __aexit__(self, *_):
        for task in self._tasks:
            task.cancel()
        await self._socket.close()

    async def ask(self, do, **fields):
        """Sends `{"do": do, **fields}` and waits for its reply; raises `Refused` with the server's words."""
        number = next(self._ids)
        reply = self._replies[number] = asyncio.get_running_loop().create_future()
        await self._socket.send(json.dumps({"id": number, "do": do, **fields}))
        reply = await reply
        if not reply["ok"]:
            raise Refused(": ".join(filter(None, [reply["error"], reply.get("hint")])))
        return reply

    async def states(self, rate_hz=60, contacts=False):
        """States at this rate until the connection ends, newest first: a reader that is slow skips, and `seq` and `dropped` say so."""
        await self.ask("subscribe", rate_hz=rate_hz, contacts=contacts, history=False)
        while (state := await self._states.get()) is not None:
            yield state

    async def place(self, obj, position_m, orientation_xyzw=(0.0, 0.0, 0.0, 1.0)):
        """Wishes a movable object to a pose in the world. It follows within its limits of speed, and never through the tool."""
        return await self.ask("place", object=obj, pose={"p": list(map(float, position_m)), "q": list(map(float, orientation_xyzw))})

    async def clay(self):
        """What is known of the clay: `samples`, `craft`, `undo`, … (docs/api.md, section 12)."""
        return json.loads(await self._get("clay"))

    async def clay_samples(self):
        """The samples of the clay as a NumPy array with the fields `position` (m, map frame), `normal` (parts of 127) and `color` (sRGB)."""
        import numpy as np

        sample = np.dtype([("position", "<f4", 3), ("normal", "i1", 3), ("", "V1"), ("color", "u1", 3), ("", "V1")])
        return np.frombuffer(await self._get("clay/points"), sample, offset=32)

    async def take_tool(self, craft=None, **settings):
        """Another craft of the tool on clay, or other settings: `brush_m`, `falloff`, `color`, `depth_m`, `is_sharp`. What is not given stays."""
        return await self.ask("clay_take", **({"craft": craft} if craft else {}), **settings)

    @contextlib.asynccontextmanager
    async def hold(self):
        """Holds the clay as the arm's first button does: `async with arm.hold(): …`. Only while force flows."""
        await self.ask("clay_hold", held=True)
        beating = asyncio.create_task(self._beat_of_hold())
        try:
            yield
        finally:
            beating.cancel()
            await self.ask("clay_hold", held=False)

    async def undo(self):
        """Takes the last stroke on the clay back."""
        await self.ask("clay_undo")

    async def redo(self):
        """Does the stroke again that was taken back last."""
        await self.ask("clay_redo")

    async def save(self, kind="session", file=None):
        """Writes the clay as a `session`, as `points` or as a mesh (`export`); returns the path of the file, on the machine of the server."""
        return (await self.ask("clay_save", kind=kind, **({"file": file} if file else {})))["file"]

    async def _get(self, path):
        request = urllib.request.Request(self._root + path, headers=self._headers)

        def fetch():
            try:
                with urllib.request.urlopen(request, timeout=10) as answer:
                    return answer.read()
            except urllib.error.HTTPError as refused:
                said = json.loads(refused.read() or "{}")
                raise Refused(": ".join(filter(None, [said.get("error", str(refused)), said.get("hint")]))) from None

        return await asyncio.to_thread(fetch)

    async def _beat_of_hold(self):
        while True:
            await asyncio.sleep(HOLD_BEAT_S)
            await self.ask("ping")

    async def _listen(self):
        try:
            async for message in self._socket:
                if isinstance(message, bytes):
                    continue  # only those who subscribe to the binary format get it
                message = json.loads(message)
                if message["type"] == "reply":
                    reply = self._replies.pop(message.get("id"), None)
                    if reply and not reply.done():
                        reply.set_result(message)
                elif message["type"] == "event":
                    self.events.append(message)
                elif message["type"] == "state":
                    self._put(message)
        except websockets.ConnectionClosed:
            pass
        finally:
            self._put(None)
            for reply in self._replies.values():
                reply.set_exception(Refused("the connection has ended")) if not reply.done() else None

    def _put(self, state):
        if self._states.full():
            self._states.get_nowait()
        self._states.put_nowait(state)

    async def _beat(self):
        while True:
            await asyncio.sleep(self._heartbeat_ms / 1000 / 3)
            await self.ask("heartbeat", timeout_ms=self._heartbeat_ms)
