"""MuJoCo: signed distance fields of both meshes, the solver's own contact forces on a free body at rest."""

import mujoco
import numpy as np
import wrench_csv

# Of 10, 40 (the default) to 200 starting points and 10 to 30 iterations, and of a tool as a convex mesh or as a field, what gave the smallest angles.
SCENE = """<mujoco>
  <option gravity="0 0 0" sdf_iterations="30" sdf_initpoints="200"/>
  <asset><mesh name="part" file="{folder}/part.obj"/><mesh name="tool" file="{folder}/tool.obj"/></asset>
  <worldbody>
    <geom type="sdf" mesh="part" condim="1"/>
    <body><freejoint/><geom type="sdf" mesh="tool" condim="1" mass="1"/></body>
  </worldbody>
</mujoco>"""


def prepare(folder):
    model = mujoco.MjModel.from_xml_string(SCENE.format(folder=folder))
    data = mujoco.MjData(model)

    def ask(position, quaternion):
        data.qpos[:3] = position
        data.qpos[3:] = quaternion[[3, 0, 1, 2]]
        data.qvel[:] = 0.0
        mujoco.mj_forward(model, data)

    def read(position):
        force, torque = np.zeros(3), np.zeros(3)
        of_contact = np.zeros(6)
        for idx, contact in enumerate(data.contact):
            mujoco.mj_contactForce(model, data, idx, of_contact)
            # From the first to the second geometry, which is the tool.
            push = contact.frame[:3] * of_contact[0]
            force += push
            torque += np.cross(contact.pos - position, push)
        return force, torque

    settings = (
        f"MuJoCo {mujoco.__version__}: SDF of both meshes (octree as it comes), 200 starting points, 30 iterations, at most {mujoco.mjMAXCONPAIR} contacts, "
        "default solver and impedance, no friction; mj_forward of a free body of 1 kg at rest"
    )
    return settings, ask, read


wrench_csv.main(prepare)
