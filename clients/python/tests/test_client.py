"""The client against a real run."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import HUNG_S, LIFT, LIFTED_M, OPTIONS, lifted

from hapticd import Client, Conflict, Disconnected, Forbidden, Invalid, NoAnswer, Pose, Run, RunError, State, Unknown, off_causes, state_names

STIFFNESS = "contact_stiffness_n_per_m"


def test_states_come_in_turn_and_carry_what_is_felt(arm: Client) -> None:
    lifted(arm)
    seen: list[State] = []
    for state in arm.states(rate_hz=200, contacts=True, history=True, backlog=10_000):
        seen.append(state)
        if state.contacts > 0 and len(seen) > 100 and any(one.points is not None and len(one.points) for one in seen):
            break
    assert all(after.tick > before.tick and after.seq == before.seq + 1 for before, after in zip(seen, seen[1:]))
    assert seen[-1].state == "ENABLED" and seen[-1].device_cp_world is not None
    assert abs(np.linalg.norm(seen[-1].tool_cp.q) - 1) < 1e-9
    rows = np.concatenate([state.history for state in seen[1:] if state.history is not None])
    assert rows.shape[1] == 5 and np.all(np.diff(rows[:, 0]) > 0)
    points = [state.points for state in seen if state.points is not None and len(state.points)]
    # The block stands on the lift, whose top was at z = 0.
    assert np.all(np.abs(points[-1][:, 2] - LIFTED_M) < 0.002) and np.all(points[-1][:, 3] >= 0)


def test_binary_states_say_what_the_others_say(run: Run, arm: Client) -> None:
    states: dict[int, State] = {}
    reads = threading.Event()

    def read() -> None:
        with run.connect() as other:
            for state in other.states(rate_hz=1000, backlog=10_000):
                states[state.tick] = state
                reads.set()
                if len(states) >= 1500:
                    return

    reader = threading.Thread(target=read)
    reader.start()
    assert reads.wait(HUNG_S)
    rows = arm.capture(1.0)
    reader.join(HUNG_S)
    ticks = rows["tick"].astype(np.int64)
    assert ticks[-1] - ticks[0] == len(rows) - 1 + int(rows["dropped"][-1]) - int(rows["dropped"][0]), "every tick came or is counted"
    assert rows["time_ns"][-1] - rows["time_ns"][0] >= 1e9
    both = [(row, states[int(row["tick"])]) for row in rows if int(row["tick"]) in states]
    assert len(both) > 100, "the two streams ran at the same time"
    for row, state in both:
        for field in ("measured_cp", "tool_cp"):
            assert np.array_equal(row[field]["p"], getattr(state, field).p) and np.array_equal(row[field]["q"], getattr(state, field).q)
        for field in ("servo_cf", "measured_cf", "contact_cf"):
            assert np.array_equal(row[field]["f"], getattr(state, field).f) and np.array_equal(row[field]["t"], getattr(state, field).t)
        for field in ("time_ns", "max_depth_m", "clearance_m", "contacts", "buttons", "scene_idx"):
            assert row[field] == getattr(state, field), field
        assert abs(row["compute_us"] - state.compute_us) < 1e-3 * state.compute_us + 1e-3
        assert state_names(row) == state.state and off_causes(row) == state.off_cause
    assert np.all(rows["faults"] == 0)


def test_a_slow_reader_gets_the_newest_and_sees_the_gap(arm: Client) -> None:
    states = arm.states(rate_hz=500)
    first = next(states)
    time.sleep(0.5)
    next(states)
    third = next(states)
    assert third.seq > first.seq + 10
    assert arm.state().tick - third.tick < third.tick - first.tick, "what waited meanwhile is gone"


def test_a_second_stream_ends_the_first(arm: Client) -> None:
    first = arm.states(rate_hz=100)
    next(first)
    second = arm.states(rate_hz=50)
    next(second)
    assert len(list(first)) <= 1, "at most what had come"
    assert next(second).state
    second.close()
    assert len(arm.capture(0.1)) > 10


def test_parameters_are_set_and_their_ranges_told_in_the_servers_words(arm: Client) -> None:
    parameter = arm.parameters()[STIFFNESS]
    assert parameter.least < parameter.value < parameter.most
    arm.events()
    arm.set(STIFFNESS, 2000.0)
    assert arm.wait_for("parameter", STIFFNESS).text and arm.get(STIFFNESS) == 2000.0
    for value in (-1.0, parameter.most * 1.01):
        with pytest.raises(Invalid, match=rf"{STIFFNESS}` goes from {parameter.least:g} to {parameter.most:g}, not to") as refused:
            arm.set(STIFFNESS, value)
        assert refused.value.status == 400 and isinstance(refused.value, ValueError)
    with pytest.raises(LookupError, match="known here: .*friction_static"):
        arm.set("stiffness", 1.0)
    with pytest.raises(LookupError, match="friction_static"):
        arm.get("stiffness")
    with pytest.raises(ValueError):
        arm.set(STIFFNESS, float("nan"))
    assert arm.get(STIFFNESS) == 2000.0, "a refusal changes nothing"
    arm.set(STIFFNESS, parameter.scene)


def test_a_part_goes_where_it_was_wished(arm: Client) -> None:
    scene = arm.scene()
    (lift,) = (one for one in scene.objects if one.movable)
    info = arm.info()
    assert info["rate_hz"] == 1000 and info["device"]["profile"] == "sim-sigma7" and info["name"] == scene.name
    assert (scene.name, lift.name, scene.objects[-1].role, scene.clay) == ("lift with block", "lift", "tool", False)
    for height_m in (0.003, 0.0):
        arm.place("lift", [0, 0, height_m])
        state = arm.wait_until(lambda state: abs(state.objects[0].p[2] - height_m) < 1e-5)
        assert np.allclose(state.objects[0].q, [0, 0, 0, 1])
    with pytest.raises(Unknown, match="lift"):
        arm.place("wheel", [0, 0, 0])
    mesh = arm.mesh(lift)
    assert np.allclose(mesh.vertices.max(0)[:2], 0.03) and mesh.triangles.max() < len(mesh.vertices)


def test_the_hand_of_a_simulated_arm_goes_where_it_is_told(arm: Client) -> None:
    arm.hand.move_to([0.0, 0.0, 0.03])
    state = arm.wait_until(lambda state: abs(state.tool_cp.p[2] - 0.03) < 5e-4)
    assert state.hand is not None and state.hand.order >= 1 and state.hand.waited_us > 0
    begin, end = Pose(np.array([0.0, 0.0, 0.03]), np.array([0.0, 0.0, 0.0, 1.0])), Pose(np.array([0.005, 0.0, 0.025]), np.array([0.0, 0.0, 0.0, 1.0]))
    arm.hand.follow([(0.0, begin), (0.4, end)])
    arm.wait_until(lambda state: bool(np.allclose(state.tool_cp.p, end.p, atol=5e-4)))
    with pytest.raises(ValueError, match="rise"):
        arm.hand.follow([(0.0, begin), (0.0, end)])
    with pytest.raises(Invalid):
        arm.hand.move_to([0.0, 0.0, 5000.0])
    arm.hand.restart()
    arm.wait_until(lambda state: abs(state.tool_cp.p[2] - 0.025) > 1e-3)


def test_no_client_sends_a_force(arm: Client) -> None:
    with pytest.raises(Invalid):
        arm._connection.ask("servo_cf", {"f": [0, 0, 1], "t": [0, 0, 0]})
    assert arm.state().state == "ENABLED"


def test_disable_takes_the_force(arm: Client) -> None:
    arm.disable()
    state = arm.wait_until(lambda state: state.state == "DISABLED" and not state.is_busy)
    assert not np.any(state.servo_cf.f) and state.device_cp_world is None and state.off_cause == "software"


def test_silence_takes_the_force_and_leave_does_not(run: Run, arm: Client) -> None:
    with run.connect(heartbeat_ms=1500) as other:
        time.sleep(2.0)
        assert arm.state().phase == "enabled", "a thread says that it lives"
        other.end_heartbeat()
    time.sleep(2.0)
    assert arm.state().phase == "enabled", "it took leave"
    run.connect(heartbeat_ms=1500).close()
    state = arm.wait_until(lambda state: state.state == "DISABLED")
    assert state.off_cause == "heartbeat"
    assert arm.wait_for("heartbeat").text
    arm.enable()
    arm.wait_until(lambda state: state.phase == "enabled")
    arm.beat(timeout_ms=200)
    assert arm.wait_until(lambda state: state.state == "DISABLED").off_cause == "heartbeat", "by hand, and then no more"
    arm.end_heartbeat()
    with pytest.raises(Invalid, match="goes from 20 to 10000"):
        run.connect(heartbeat_ms=5)


def test_rates_are_refused_in_the_servers_words(arm: Client) -> None:
    for rate_hz in (0.01, 5000.0):
        with pytest.raises(Invalid, match="rate_hz"):
            next(arm.states(rate_hz))
        with pytest.raises(Invalid, match="rate_hz"):
            arm.capture(0.1, rate_hz)


def test_waiting_has_an_end(arm: Client) -> None:
    with pytest.raises(NoAnswer, match="the run is enabled"):
        arm.wait_until(lambda _: False, timeout_s=0.2)
    with pytest.raises(NoAnswer, match="no event `fault speed`"):
        arm.wait_for("fault", "speed", timeout_s=0.2)
    with pytest.raises(TimeoutError):
        arm.capture(60.0, rate_hz=10, timeout_s=0.3)


def test_another_scene_and_the_end_of_a_run() -> None:
    with Run(LIFT, *OPTIONS, clock="virtual") as run, run.connect() as arm:
        assert {"block-on-plane", "lift-with-block"} <= set(arm.scenes())
        arm.switch("block-on-plane")
        arm.wait_for("scene", "rendered")
        arm.wait_until(lambda state: state.scene_idx == 1)
        assert arm.scene().name == "block on plane"
        with pytest.raises(Unknown):
            arm.switch("no-such-scene")
        with pytest.raises(Invalid, match="simulated time.*`record`"):
            arm.capture(0.5)
        states = arm.states(rate_hz=100)
        next(states)
        arm.stop()
        assert run.wait(HUNG_S) == 0, run.talk
        assert run.result is not None and run.result["faults"] == []
        for _ in states:
            pass
        with pytest.raises(Disconnected, match="ended"):
            arm.enable()
        with pytest.raises(Disconnected):
            arm.wait_for("waiting", "nothing")


def test_a_run_ends_with_the_program_that_started_it(state_home: Path) -> None:
    code = f"import os\nfrom hapticd import Run\nrun = Run({str(LIFT)!r}, *{OPTIONS!r})\nprint(run.address, flush=True)\nos.kill(os.getpid(), 9)"
    died = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=HUNG_S)
    assert died.returncode == -9 and died.stdout.startswith("http://"), died.stderr
    begin_s = time.monotonic()
    while time.monotonic() < begin_s + HUNG_S / 2:
        try:
            Client(died.stdout.strip()).close()
        except Disconnected:
            return
        time.sleep(0.1)
    raise AssertionError("it goes on")


def test_a_token_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HAPTICD_TOKEN", "sixteen-letters-at-least")
    with Run(LIFT, *OPTIONS) as run:
        with run.connect() as arm:
            assert arm.parameters()
        monkeypatch.delenv("HAPTICD_TOKEN")
        for wrong in (None, "another-one-of-sixteen"):
            with pytest.raises(Forbidden) as refused:
                Client(run.address, token=wrong)
            assert refused.value.status == 401
        with Client(f"{run.address}#token=sixteen-letters-at-least") as arm:
            assert arm.version


def test_what_cannot_be_reached_or_started_is_told() -> None:
    with pytest.raises(Disconnected, match="127.0.0.1:1: .*hapticd run"):
        Client("http://127.0.0.1:1")
    with pytest.raises(ValueError, match="no address"):
        Client("ftp://127.0.0.1")
    with pytest.raises(RunError, match="no-such-scene.toml"):
        Run("no-such-scene.toml")
    with pytest.raises(RunError, match="set HAPTICD"):
        Run(LIFT, program="/no/such/program")


def test_recordings_of_clients_are_refused_twice(arm: Client) -> None:
    begun = arm.record("twice")
    assert begun.file.endswith("twice.mcap")
    with pytest.raises(Conflict):
        arm.record()
    assert arm.end_recording().dropped == 0
    with pytest.raises(Conflict):
        arm.end_recording()
    with pytest.raises(Conflict, match="twice"):
        arm.record("twice")
