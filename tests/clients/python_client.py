"""The Python client and its example against a real run. Called by scripts/client-test."""

import asyncio
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import time

import numpy as np

from hapticd_client import Client, Refused

HAPTICD, FOLDER = map(pathlib.Path, sys.argv[1:3])
SCENE = "config/scenes/lift-with-block.toml"
HUNG_S = 60

# The hand hovers just over a ball of clay: within the brush, and not in contact.
CLAY = """version = 1
[sculpt]
shape = { sphere_mm = 15 }
spacing_mm = 1.5
raster = [16, 16, 16]
brush_mm = 6
tool = "touch"
[tool]
shape = { sphere_mm = 3 }
voxel_size_mm = 1.0
start_position_mm = [0, 0, 20]
[device]
profile = "sim-sigma7"
"""


class Run:
    """A run with a monitor at a port of its own."""

    def __init__(self, verb="run", scene=SCENE):
        self.command = [HAPTICD, verb, scene, "--cache", "off", "--monitor", "127.0.0.1:0", "--realtime", "best-effort"]

    def __enter__(self):
        self.log = open(FOLDER / "run.log", "w+")
        self.process = subprocess.Popen(
            self.command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {"XDG_STATE_HOME": str(FOLDER.resolve() / "state")},
        )
        for line in self.process.stderr:
            self.log.write(line)
            if found := re.match(r"monitor: (http://\S+)", line):
                self.url = found[1]
            if line.startswith("state: enabled"):
                break
        assert hasattr(self, "url"), f"no monitor; see {self.log.name}"
        return self

    def __exit__(self, *_):
        self.process.terminate()
        self.log.write(self.process.stderr.read())
        self.status = self.process.wait(HUNG_S)


async def until(arm, condition, what):
    """The first state for which the condition holds."""
    async with asyncio.timeout(HUNG_S):
        async for state in arm.states(rate_hz=100):
            if condition(state):
                return state
    raise AssertionError(what)


def fields_of_ros_table():
    """What docs/ros2.md says that a state has."""
    text = pathlib.Path("docs/ros2.md").read_text()
    table = text.split("## From hapticd")[1].split("##")[0]
    return re.findall(r"^\| `(\w+)` \| `", table, flags=re.M)


async def drive(url):
    async with Client(url, heartbeat_ms=1000) as arm:
        state = await until(arm, lambda state: state["state"] == "ENABLED", "enabled")
        missing = [name for name in fields_of_ros_table() if name not in state]
        assert len(fields_of_ros_table()) > 10 and not missing, f"docs/ros2.md names what no state has: {missing}"

        await arm.ask("disable")
        state = await until(arm, lambda state: state["state"] == "DISABLED" and not state["is_busy"], "disabled")
        assert not np.any(state["servo_cf"]["f"]), state["servo_cf"]
        await arm.ask("enable")
        await until(arm, lambda state: state["state"] == "ENABLED" and not state["is_busy"], "enabled again")

        height_m = 0.003
        await arm.place("lift", [0, 0, height_m])
        at_height = lambda state: any(abs(stand["p"][2] - height_m) < 1e-5 for stand in state["objects"])
        await until(arm, at_height, "the lift where it was wished")
        await arm.ask("set", parameter="contact_stiffness_n_per_m", value=2000.0)

        for do, fields, word in [
            ("place", {"object": "wheel", "pose": {"p": [0, 0, 0], "q": [0, 0, 0, 1]}}, "lift"),
            ("set", {"parameter": "contact_stiffness_n_per_m", "value": -1.0}, "contact_stiffness_n_per_m"),
            ("servo_cf", {"f": [0, 0, 1], "t": [0, 0, 0]}, ""),
            ("clay_undo", {}, "hapticd sculpt"),
        ]:
            await refused(arm.ask(do, **fields), word)
        state = await until(arm, lambda state: True, "a state")
        assert state["state"] == "ENABLED", "a refusal changes nothing"

        # Silent for too long once, and on guard again with the next beat.
        time.sleep(1.5)
        await until(arm, lambda state: state["state"] == "DISABLED", "disabled by silence")
        await arm.ask("enable")
        await until(arm, lambda state: state["state"] == "ENABLED" and not state["is_busy"], "enabled again")

    # Gone: its heartbeat with it.
    async with Client(url) as arm:
        await until(arm, lambda state: state["state"] == "DISABLED", "disabled by its end")


async def refused(doing, word):
    """Whatever it is, the server says no to it, and says this word."""
    try:
        await doing
    except Refused as refusal:
        assert word in str(refusal), refusal
    else:
        raise AssertionError(f"done, and should not be: {word}")


async def clay_where(arm, condition, what):
    """The first facts of the clay for which the condition holds."""
    async with asyncio.timeout(HUNG_S):
        while not condition(facts := await arm.clay()):
            await asyncio.sleep(0.02)
    return facts


async def sculpt(url):
    async with Client(url) as arm:
        before = await arm.clay()
        samples = await arm.clay_samples()
        assert len(samples) == before["samples"], len(samples)
        assert np.allclose(np.linalg.norm(samples["position"], axis=1), 0.015, atol=1e-3), "a ball"
        await refused(arm.undo(), "no stroke")
        await refused(arm.take_tool("knit"), "knit")
        await refused(arm.save("photo"), "photo")
        await refused(arm.save("points", "../ball"), "letters")

        await arm.take_tool("emboss", brush_m=0.008, depth_m=0.001)
        facts = await arm.clay()
        assert (facts["craft"], facts["brush_m"], facts["depth_m"]) == ("emboss", 0.008, 0.001), facts
        async with arm.hold():
            await clay_where(arm, lambda facts: facts["undo"] == 1, "a stroke")
            # Longer than a silence may be.
            await asyncio.sleep(1.5)
            assert (await arm.clay())["is_held"]
        facts = await clay_where(arm, lambda facts: not facts["is_held"], "let go")
        assert facts["is_unsaved"], facts
        assert np.max(np.linalg.norm((await arm.clay_samples())["position"], axis=1)) > 0.0154, "a dome"
        await arm.undo()
        await clay_where(arm, lambda facts: (facts["undo"], facts["redo"]) == (0, 1), "taken back")
        await arm.redo()
        await clay_where(arm, lambda facts: (facts["undo"], facts["redo"]) == (1, 0), "done again")
        for kind, ending in (("points", "ply"), ("export", "ply"), ("session", "session")):
            file = pathlib.Path(await arm.save(kind, f"ball {kind}"))
            assert file.name == f"ball {kind}.{ending}" and file.stat().st_size > 1000, file
            await refused(arm.save(kind, f"ball {kind}"), "exists already")
        await clay_where(arm, lambda facts: not facts["is_unsaved"], "saved")
        await arm.ask("disable")
        await until(arm, lambda state: state["state"] == "DISABLED" and not state["is_busy"], "disabled")
        await refused(arm.hold().__aenter__(), "enable first")


def example(url, obj, *more):
    command = [sys.executable, "examples/python/move_and_plot.py", "--url", url, "--object", obj, *more]
    return subprocess.run(command, capture_output=True, text=True, timeout=HUNG_S)


def refusals(url):
    for ended, word in [(example(url, "nope"), "lift"), (example("http://127.0.0.1:1", "lift"), "127.0.0.1:1")]:
        assert ended.returncode == 1 and word in ended.stderr and len(ended.stderr.splitlines()) == 1, ended.stderr


def plot(url):
    out = FOLDER / "felt.png"
    ended = example(url, "lift", "--amplitude-m", "0.012", "--seconds", "3", "--out", out)
    assert ended.returncode == 0, ended.stderr
    print(ended.stdout, end="")
    written = pathlib.Path(re.search(r"wrote (\S+)", ended.stdout)[1])
    if written.suffix == ".png":
        assert written.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    else:
        rows = np.loadtxt(written, delimiter=",", skiprows=1)
        assert rows.shape[1] == 5 and np.all(np.isfinite(rows)), rows.shape
        assert np.ptp(rows[:, 0]) >= 3 and np.all(np.diff(rows[:, 0]) > 0), "time goes on"
        assert np.mean(rows[:, 4]) > 0.5 and np.ptp(rows[:, 3]) > 1, "the tool was lifted while force flowed"


with Run() as run:
    asyncio.run(drive(run.url))
    refusals(run.url)
    plot(run.url)
assert run.status == 0, f"the run ended with {run.status}; see {run.log.name}"
(FOLDER / "clay.toml").write_text(CLAY)
with Run("sculpt", FOLDER / "clay.toml") as run:
    asyncio.run(sculpt(run.url))
assert run.status == 0, f"the run on clay ended with {run.status}; see {run.log.name}"
print("the Python client works")
