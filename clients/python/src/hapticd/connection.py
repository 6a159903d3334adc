"""One WebSocket to a run, read by a thread of its own, and the HTTP connection beside it."""

from __future__ import annotations

import collections
import contextlib
import http.client
import itertools
import json
import threading
import time
import urllib.parse
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeout
from dataclasses import dataclass, field
from typing import Any

from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from hapticd.errors import Disconnected, NoAnswer, refusal
from hapticd.facts import Event

API = 1
KEPT_EVENTS = 1000


@dataclass(frozen=True, slots=True)
class Address:
    """Where a run listens, and the token that it wants."""

    host: str
    port: int
    token: str | None

    @classmethod
    def parse(cls, address: str, token: str | None) -> Address:
        """Takes what `hapticd run` announces (`http://127.0.0.1:7878/`), `HOST:PORT`, or the page's own address with `#token=…`."""
        parts = urllib.parse.urlsplit(address if "://" in address else f"http://{address}")
        if parts.scheme not in ("http", "ws") or not parts.hostname:
            raise ValueError(f"`{address}` is no address of a run; such as http://127.0.0.1:7878")
        fragment = urllib.parse.parse_qs(parts.fragment).get("token")
        return cls(parts.hostname, parts.port or 80, token or (fragment[0] if fragment else None))

    @property
    def place(self) -> str:
        """`HOST:PORT`, with the brackets that IPv6 wants."""
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"

    @property
    def headers(self) -> dict[str, str]:
        """What every request carries."""
        return {"Authorization": f"Bearer {self.token}"} if self.token else {}

    def get(self, path: str, timeout_s: float) -> bytes | None:
        """The body of `GET path`; None for 204. Raises what the server refuses."""
        return self.send("GET", path, None, timeout_s)

    def send(self, method: str, path: str, body: bytes | None, timeout_s: float) -> bytes | None:
        """The body of the answer; None for 204. Raises what the server refuses."""
        connection = http.client.HTTPConnection(self.host, self.port, timeout=timeout_s)
        try:
            connection.request(method, path, body=body, headers=self.headers)
            answer = connection.getresponse()
            said = answer.read()
        except TimeoutError as late:
            raise NoAnswer(f"no answer to {method} {path} within {timeout_s:g} s") from late
        except (OSError, http.client.HTTPException) as error:
            raise Disconnected(f"no answer from {self.place}: {error}") from error
        finally:
            connection.close()
        if answer.status == 204:
            return None
        if answer.status not in (200, 202):
            raise refusal(answer.status, _json(said))
        return said


class Stream:
    """States that have come and the caller has not taken yet; of more than `backlog` the oldest go."""

    def __init__(self, is_binary: bool, backlog: int | None) -> None:
        self.is_binary = is_binary
        self._waiting: collections.deque[Any] = collections.deque(maxlen=backlog)
        self._changed = threading.Condition()
        self._is_over = False

    def put(self, state: Any) -> None:
        """Adds one."""
        with self._changed:
            self._waiting.append(state)
            self._changed.notify()

    def end(self) -> None:
        """No more will come."""
        with self._changed:
            self._is_over = True
            self._changed.notify_all()

    def take(self, deadline_s: float | None = None) -> Any | None:
        """The next one, None when there will be none. Raises NoAnswer at this time of the monotonic clock."""
        with self._changed:
            while not self._waiting:
                if self._is_over:
                    return None
                left_s = None if deadline_s is None else deadline_s - time.monotonic()
                if left_s is not None and left_s <= 0:
                    raise NoAnswer("no state came in time")
                self._changed.wait(left_s)
            return self._waiting.popleft()


@dataclass(slots=True)
class _Asked:
    reply: Future[dict[str, Any]] = field(default_factory=Future)
    stream: Stream | None = None
    """Takes the place of the present one with the reply."""


class Connection:
    """Requests with their replies, one stream of states, events. Any thread may ask."""

    def __init__(self, address: Address, timeout_s: float) -> None:
        self.address, self.timeout_s = address, timeout_s
        self._opened = contextlib.ExitStack()
        self._socket = _open(address, timeout_s, self._opened)
        self._ids = itertools.count(1)
        self._lock = threading.Lock()
        self._asked: dict[int, _Asked] = {}
        self._stream: Stream | None = None
        self._ended: str | None = None
        self.events: collections.deque[Event] = collections.deque(maxlen=KEPT_EVENTS)
        self.happened = threading.Condition()
        try:
            self.hello: dict[str, Any] = json.loads(self._socket.recv(timeout=timeout_s))
            if self.hello.get("api") != API:
                raise Disconnected(f"this client speaks version {API} of the API, the server {self.hello.get('api')}")
        except (TimeoutError, ConnectionClosed) as error:
            raise Disconnected(f"{address.place} does not greet: {error}") from error
        finally:
            if not hasattr(self, "hello") or self.hello.get("api") != API:
                self._opened.close()
        self._reader = threading.Thread(target=self._read, name="hapticd-client", daemon=True)
        self._reader.start()

    def ask(
        self, do: str, fields: Mapping[str, Any] | None = None, *, stream: Stream | None = None, timeout_s: float | None = None
    ) -> dict[str, Any]:
        """Sends `{"do": do, **fields}` and waits for its reply; raises what the server refuses. A stream takes its place with the reply."""
        asked, number = _Asked(stream=stream), next(self._ids)
        with self._lock:
            if self._ended is not None:
                raise Disconnected(self._ended)
            self._asked[number] = asked
        wait_s = self.timeout_s if timeout_s is None else timeout_s
        try:
            self._send({"id": number, "do": do, **(fields or {})})
            reply = asked.reply.result(wait_s)
        except FutureTimeout as late:
            raise NoAnswer(f"no reply to `{do}` within {wait_s:g} s") from late
        finally:
            with self._lock:
                self._asked.pop(number, None)
        if not reply["ok"]:
            raise refusal(reply["status"], reply)
        return reply

    def tell(self, do: str, **fields: Any) -> None:
        """Sends a request without waiting for its reply."""
        self._send({"do": do, **fields})

    def json(self, path: str) -> Any:
        """What `GET path` answers, read as JSON."""
        return json.loads(self.address.get(path, self.timeout_s) or b"null")

    def leave(self, stream: Stream) -> None:
        """Ends a stream, if it is still the one that runs."""
        with self._lock:
            is_mine = self._stream is stream and self._ended is None
            if is_mine:
                self._stream = None
        if is_mine:
            self.tell("subscribe", rate_hz=0)

    def close(self) -> None:
        """Ends the connection and what waits for it."""
        self._opened.close()
        self._reader.join(self.timeout_s)

    def why_ended(self) -> str | None:
        """Why there is no connection any more; None while there is one."""
        return self._ended

    def _send(self, request: dict[str, Any]) -> None:
        try:
            self._socket.send(json.dumps(request, allow_nan=False))
        except ConnectionClosed as closed:
            raise Disconnected(_why(closed)) from closed

    def _read(self) -> None:
        why = "the connection has ended"
        try:
            while True:
                self._hear(self._socket.recv())
        except ConnectionClosed as closed:
            why = _why(closed)
        finally:
            # Whatever ended it: a connection without a reader sends no signs of life.
            self._socket.close()
            with self._lock:
                self._ended = why
                asked, stream = list(self._asked.values()), self._stream
            for one in asked:
                one.reply.set_exception(Disconnected(why))
            if stream is not None:
                stream.end()
            with self.happened:
                self.happened.notify_all()

    def _hear(self, message: str | bytes) -> None:
        if isinstance(message, bytes):
            if self._stream is not None and self._stream.is_binary:
                self._stream.put(message)
            return
        said = json.loads(message)
        match said.get("type"):
            case "state" if self._stream is not None and not self._stream.is_binary:
                self._stream.put(said)
            case "event":
                with self.happened:
                    self.events.append(Event.from_json(said))
                    self.happened.notify_all()
            case "reply":
                self._answer(said)

    def _answer(self, said: dict[str, Any]) -> None:
        number = said.get("id")
        with self._lock:
            asked = self._asked.pop(number, None) if isinstance(number, int) else None
            # Here and not in the thread that asked: the first state follows at once.
            before = self._stream
            if asked is not None and asked.stream is not None and said["ok"]:
                self._stream = asked.stream
        if asked is None:
            return
        if before is not None and self._stream is not before:
            before.end()
        asked.reply.set_result(said)


class Every:
    """Does something again and again, on a thread of its own, until it is stopped or the connection has ended."""

    def __init__(self, period_s: float, act: Callable[[], None]) -> None:
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._go, args=(period_s, act), name="hapticd-beat", daemon=True)
        self._thread.start()

    def _go(self, period_s: float, act: Callable[[], None]) -> None:
        while not self._stopped.wait(period_s):
            try:
                act()
            except Disconnected:
                return

    def stop(self) -> None:
        """Ends it; afterwards nothing is done any more."""
        self._stopped.set()
        self._thread.join()


def _open(address: Address, timeout_s: float, opened: contextlib.ExitStack) -> ClientConnection:
    # A proxy of the environment has no business on the way to an arm. States are small and quick: packing them only takes time.
    try:
        return opened.enter_context(
            connect(
                f"ws://{address.place}/api/v{API}/ws",
                additional_headers=address.headers,
                proxy=None,
                compression=None,
                open_timeout=timeout_s,
                max_size=2**24,
            )
        )
    except InvalidStatus as refused:
        raise refusal(refused.response.status_code, _json(refused.response.body or b"")) from None
    except (OSError, InvalidHandshake) as error:
        raise Disconnected(f"no run answers at {address.place}: {error}; start one with `hapticd run SCENE`") from error


def _why(closed: ConnectionClosed) -> str:
    if closed.rcvd is not None and closed.rcvd.code == 1001:
        return "the run has ended"
    if closed.rcvd is not None and closed.rcvd.reason:
        return f"the server ended the connection: {closed.rcvd.reason}"
    return "the connection has ended"


def _json(body: bytes | bytearray) -> Any:
    try:
        return json.loads(body)
    except ValueError:
        return None
