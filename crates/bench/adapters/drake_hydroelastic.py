"""Drake, hydroelastic contact: the tool is compliant, the part rigid."""

from importlib.metadata import version

import numpy as np
import wrench_csv
from pydrake.common.eigen_geometry import Quaternion
from pydrake.geometry import AddCompliantHydroelasticProperties, AddRigidHydroelasticProperties, Convex, Mesh, ProximityProperties
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, ContactModel, CoulombFriction
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import DiagramBuilder

# Pressure for each metre of depth, N/m³.
PRESSURE = 1e10


def prepare(folder):
    vertices, triangles = wrench_csv.mesh(f"{folder}/tool.obj")
    if not wrench_csv.is_convex(vertices, triangles):
        raise SystemExit("the tool is not convex: it needs a tetrahedral mesh, which the scene does not have")
    # The field of a convex body rises linearly from each face to the modulus at the centroid: what a metre of depth presses with is modulus / height
    # of the centroid above the face. The face of the median, by area, is made to press as the closed forms do.
    normals, heights, areas = wrench_csv.faces(vertices, triangles)
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    volumes = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
    centroid = np.einsum("i,ij->j", volumes, a + b + c) / (4.0 * volumes.sum())
    above = heights - normals @ centroid
    order = np.argsort(above)
    height = above[order][np.searchsorted(np.cumsum(areas[order]), 0.5 * areas.sum())]

    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    plant.set_contact_model(ContactModel.kHydroelastic)
    rigid, compliant = ProximityProperties(), ProximityProperties()
    AddRigidHydroelasticProperties(1.0, rigid)
    AddCompliantHydroelasticProperties(1.0, PRESSURE * height, compliant)
    for properties in (rigid, compliant):
        properties.AddProperty("material", "coulomb_friction", CoulombFriction(0.0, 0.0))
        properties.AddProperty("material", "hunt_crossley_dissipation", 0.0)
    tool = plant.AddRigidBody("tool", SpatialInertia.SolidSphereWithMass(0.1, 0.005))
    plant.RegisterCollisionGeometry(tool, RigidTransform(), Convex(f"{folder}/tool.obj"), "tool", compliant)
    plant.RegisterCollisionGeometry(plant.world_body(), RigidTransform(), Mesh(f"{folder}/part.obj"), "part", rigid)
    plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    of_plant = plant.GetMyMutableContextFromRoot(context)
    results = plant.get_contact_results_output_port()
    of_tool = plant.GetCollisionGeometriesForBody(tool)[0]

    def ask(position, quaternion):
        x, y, z, w = quaternion
        plant.SetFreeBodyPose(of_plant, tool, RigidTransform(Quaternion(w, x, y, z), position))
        results.Eval(of_plant)

    def read(position):
        found = results.Eval(of_plant)
        force, torque = np.zeros(3), np.zeros(3)
        for idx in range(found.num_hydroelastic_contacts()):
            contact = found.hydroelastic_contact_info(idx)
            surface, on_m = contact.contact_surface(), contact.F_Ac_W()
            sign = 1.0 if surface.id_M() == of_tool else -1.0
            force += sign * on_m.translational()
            torque += sign * (on_m.rotational() + np.cross(surface.centroid() - position, on_m.translational()))
        return force, torque

    # Once, so that the first pose pays for no set-up.
    ask(np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 1.0]))
    settings = (
        f"Drake {version('drake')}: hydroelastic, tool compliant (convex hull, {PRESSURE:g} N/m³), part rigid, no friction, "
        "no dissipation, continuous; contact results of a plant"
    )
    return settings, ask, read


wrench_csv.main(prepare)
