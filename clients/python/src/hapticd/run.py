"""A run of one's own: starts `hapticd`, reads which address its monitor announces, and ends it."""

from __future__ import annotations

import atexit
import json
import os
import re
import signal
import subprocess
import threading
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

from hapticd.client import Client
from hapticd.errors import HapticdError

GRACE_S = 15.0
"""A stop ramps the force down, and a studio finishes its last stroke."""


class RunError(HapticdError):
    """The program could not be started, or ended before it listened; says what it said."""


class Run:
    """`hapticd run SCENE` as a process, with its monitor on a free port of this machine.

        with Run("config/scenes/peg-in-hole.toml", "--hand-repeat", clock="virtual") as run, run.connect() as arm:
            print(arm.scene().name)

    The block ends with a stop: force ramps down, then the program ends. So it does when this program dies, as the run then reads the end of its console.
    """

    address: str
    """Where its monitor listens, `http://127.0.0.1:PORT/`."""

    def __init__(
        self,
        scene: str | Path,
        *options: str,
        clock: Literal["real", "virtual"] = "real",
        command: Literal["run", "sculpt"] = "run",
        program: str | Path | None = None,
        timeout_s: float = 120.0,
    ) -> None:
        """Starts it and waits until its monitor listens.

        `options` are those of `hapticd run --help`. `program`: else what the environment variable `HAPTICD` names, else `hapticd` of the path. Raises
        `RunError` when it cannot be started or ends at once, in its own words.
        """
        chosen = str(program or os.environ.get("HAPTICD") or "hapticd")
        line = [chosen, command, str(scene), "--clock", clock, "--monitor", "127.0.0.1:0", "--console", "--json", *options]
        try:
            # A session of its own: Ctrl-C is for this program, which then stops the run as it should be.
            self._process = subprocess.Popen(
                line, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
            )
        except OSError as error:
            raise RunError(f"cannot start `{chosen}`: {error.strerror}; set HAPTICD to the program") from error
        atexit.register(self.stop)
        self._said: list[str] = []
        self._printed = ""
        self._listens = threading.Event()
        self._threads = [threading.Thread(target=read, daemon=True) for read in (self._read_talk, self._read_result)]
        for thread in self._threads:
            thread.start()
        is_in_time = self._listens.wait(timeout_s)
        if not hasattr(self, "address"):
            status = self.stop()
            why = f"ended with {status}" if is_in_time else f"announced no monitor within {timeout_s:g} s"
            raise RunError(f"`{' '.join(line)}` {why}\n{self.talk.strip()}")

    def __enter__(self) -> Run:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.stop()

    def connect(self, *, heartbeat_ms: float | None = None, timeout_s: float = 30.0) -> Client:
        """A client of this run, when its scene is baked and the first tick is rendered. Raises `NoAnswer` where that takes longer than `timeout_s`."""
        client = Client(self.address, heartbeat_ms=heartbeat_ms, timeout_s=timeout_s)
        try:
            client.wait_until(lambda _: True)
        except BaseException:
            client.close()
            raise
        return client

    @property
    def talk(self) -> str:
        """What it said so far: states, checks, warnings."""
        return "".join(self._said)

    @property
    def result(self) -> dict[str, Any] | None:
        """What `--json` printed at its end (`hapticd run --json`); None before that, or where there was none."""
        try:
            said = json.loads(self._printed)
        except ValueError:
            return None
        return said if isinstance(said, dict) else None

    def wait(self, timeout_s: float | None = None) -> int:
        """Waits for its end and returns its exit code. Raises subprocess.TimeoutExpired when it does not come."""
        status = self._process.wait(timeout_s)
        for thread in self._threads:
            thread.join(GRACE_S)
        return status

    def stop(self) -> int:
        """Ends its console, which is a stop, or ends it by force where that does not help; returns its exit code."""
        atexit.unregister(self.stop)
        assert self._process.stdin is not None
        self._process.stdin.close()
        for number in (signal.SIGTERM, signal.SIGKILL):
            try:
                return self.wait(GRACE_S)
            except subprocess.TimeoutExpired:
                self._process.send_signal(number)
        return self.wait()

    def _read_talk(self) -> None:
        assert self._process.stderr is not None
        with self._process.stderr as talk:
            for line in talk:
                self._said.append(line)
                if found := re.match(r"monitor: (http://\S+)", line):
                    self.address = found[1]
                    self._listens.set()
        self._listens.set()

    def _read_result(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as printed:
            self._printed = printed.read()
