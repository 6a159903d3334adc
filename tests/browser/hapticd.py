"""The program under test as a process, and small scenes for it."""

import json
import math
import os
import pathlib
import queue
import re
import signal
import subprocess
import threading
import urllib.request

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]
PRESS_S = 300

SCENE = """
version = 1
name = "{name}"

[[static]]
name = "lift"
movable = true
shape = {{ plane_mm = [60.0, 60.0] }}
voxel_size_mm = 0.5
layers = 8

[tool]
shape = {{ box_mm = [20.0, 20.0, 20.0] }}
voxel_size_mm = 1.5
mass_g = 100.0
start_position_mm = [0.0, 0.0, 15.0]

[contact]
stiffness_n_per_mm3 = 2.222222222222222

[device]
profile = "sim-sigma7"
hand = "{hand}"

{more}
"""


CLAY = """
version = 1
name = "clay scene"

[sculpt]
shape = { sphere_mm = 15 }
spacing_mm = 0.6
raster = [24, 24, 24]
brush_mm = 6
color = "#2060e0"
tool = "touch"

[tool]
shape = { sphere_mm = 3 }
voxel_size_mm = 0.5
start_position_mm = [0, 0, 22]

[device]
profile = "sim-sigma7"
hand = "near.csv"
"""


def write_scenes(folder):
    """`press`: after four seconds the hand slides to and fro, pressed onto the plane. `fault`: the same with an arm that says nonsense for
    half a second. `rest`: the hand stays above. `clay`: a ball of clay, and a hand that touches it now and then."""
    heights = [0.013 if n % 2 == 0 else 0.0205 for n in range(PRESS_S)]
    near = ["t_s,x_m,y_m,z_m,qx,qy,qz,qw", *(f"{n},0,0,{z_m},0,0,0,1" for n, z_m in enumerate(heights))]
    (folder / "near.csv").write_text("\n".join(near) + "\n")
    (folder / "clay.toml").write_text(CLAY)
    rows = ["t_s,x_m,y_m,z_m,qx,qy,qz,qw"]
    for n in range(PRESS_S * 20):
        t = n / 20
        down = 0.015 - 0.0065 * min(1, max(0, t - 3))
        rows.append(f"{t:.3f},{0.012 * math.sin(max(0, t - 4)):.6f},0,{down:.6f},0,0,0,1")
    (folder / "press.csv").write_text("\n".join(rows) + "\n")
    (folder / "rest.csv").write_text(f"{rows[0]}\n0,0,0,0.015,0,0,0,1\n")
    scenes = [("press", "press.csv", ""), ("fault", "press.csv", '[device.sim]\nfault = "nan@6s+500ms"'), ("rest", "rest.csv", "")]
    for name, hand, more in scenes:
        (folder / f"{name}.toml").write_text(SCENE.format(name=f"{name} scene", hand=hand, more=more))


class Hapticd:
    """`hapticd run`, or `sculpt`, with a monitor; `with` ends it."""

    def __init__(self, program, scene, *options, address="127.0.0.1:0", command="run"):
        self.process = subprocess.Popen(
            [program, command, str(scene.resolve()), "--monitor", address, *options],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=scene.parent,
            # Recordings stay out of the user's home.
            env=os.environ | {"XDG_STATE_HOME": str(scene.resolve().parent / "state")},
        )
        self.lines = []
        found = queue.Queue()
        self.reader = threading.Thread(target=self.read, args=(found,), daemon=True)
        self.reader.start()
        self.url = found.get(timeout=60)
        if self.url is None:
            raise RuntimeError("\n".join(self.lines))

    def read(self, found):
        for line in self.process.stderr:
            self.lines.append(line.rstrip())
            if match := re.search(r"monitor: (http://\S+)", line):
                found.put(match[1])
        found.put(None)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        try:
            self.process.communicate(timeout=20)
        except subprocess.TimeoutExpired:
            self.kill()

    def kill(self):
        """Without a chance to say goodbye."""
        os.kill(self.process.pid, signal.SIGKILL)
        self.process.wait()

    def get(self, path):
        """What the API says."""
        return self.send("GET", path)

    def send(self, method, path, body=None):
        """What the API answers."""
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(f"{self.url}api/v1/{path}", data=data, method=method)
        with urllib.request.urlopen(request, timeout=10) as answer:
            return json.load(answer)
