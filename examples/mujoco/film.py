"""Renders the nut of nut_on_bolt.xml as it screws itself down, three times slower than it is.

python3 examples/mujoco/film.py PLUGIN.so FILM.gif        # needs mujoco, pillow, and OpenGL: MUJOCO_GL=egl without a screen
"""

import sys
from pathlib import Path

import mujoco
from PIL import Image

FRAMES_PER_S, SLOWER, SIZE = 20, 3, (240, 300)
END_M = 0.0055  # the nut's lower face; the head of the bolt ends at 0.005

if len(sys.argv) != 3:
    sys.exit(__doc__)
plugin, film = sys.argv[1:]
mujoco.mj_loadPluginLibrary(plugin)
model = mujoco.MjModel.from_xml_path(str(Path(__file__).parent / "nut_on_bolt.xml"))
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
frames: list[Image.Image] = []
with mujoco.Renderer(model, SIZE[1], SIZE[0]) as renderer:
    while data.qpos[2] > END_M:
        if data.time * FRAMES_PER_S * SLOWER >= len(frames):
            renderer.update_scene(data, "beside")
            frames.append(Image.fromarray(renderer.render()).quantize(24))
        mujoco.mj_step(model, data)
frames[0].save(film, save_all=True, append_images=frames[1:], duration=1000 // FRAMES_PER_S, loop=0)
print(f"{film}: {len(frames)} frames, {data.time:.2f} s of simulation")
