"""A client of hapticd, an open 6-DoF haptic rendering server (`docs/reference/api.md` of the server is the protocol).

    from hapticd import Client

    with Client() as arm:                          # http://127.0.0.1:7878
        for state in arm.states(rate_hz=60):
            print(state.servo_cf.f)

SI throughout: m, rad, s, N, N·m. Quaternions are x, y, z, w. Clients say when force may flow, set parameters, move parts and choose what the tool
does to clay; no client sends a force. Recordings are read by `hapticd.recordings`, which needs the extra `hapticd[recordings]`.
"""

from hapticd.clay import Clay, ClayFacts, ClayPoints
from hapticd.client import Client
from hapticd.errors import Conflict, Disconnected, Forbidden, HapticdError, Invalid, NoAnswer, Refused, Unavailable, Unknown
from hapticd.facts import ClientRecording, Event, Mesh, Parameter, Scene, SceneObject
from hapticd.hand import Hand
from hapticd.run import Run, RunError
from hapticd.state import STATE_DTYPE, Pose, State, Twist, Wrench, fault_names, off_causes, state_names

__all__ = [
    "STATE_DTYPE",
    "Clay",
    "ClayFacts",
    "ClayPoints",
    "Client",
    "ClientRecording",
    "Conflict",
    "Disconnected",
    "Event",
    "Forbidden",
    "Hand",
    "HapticdError",
    "Invalid",
    "Mesh",
    "NoAnswer",
    "Parameter",
    "Pose",
    "Refused",
    "Run",
    "RunError",
    "Scene",
    "SceneObject",
    "State",
    "Twist",
    "Unavailable",
    "Unknown",
    "Wrench",
    "fault_names",
    "off_causes",
    "state_names",
]

__version__ = "0.1.0"
