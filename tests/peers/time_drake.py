"""Times Drake: steps of a discrete plant, with the faster of its contact solvers."""
import importlib.metadata

import numpy as np
from peer_timing import DT, SCENE, failed, model, row, start, version
from pydrake.all import AddMultibodyPlantSceneGraph, DiagramBuilder, DiscreteContactApproximation, MultibodyPlant, Parser, RigidTransform, Simulator

version(f"Drake {importlib.metadata.version('drake')}")
for which, name in (("free", "free step"), ("contact", "gripping step, 8 contacts")):
    builder = DiagramBuilder()
    plant = AddMultibodyPlantSceneGraph(builder, DT)[0] if which == "contact" else MultibodyPlant(DT)
    plant.set_discrete_contact_approximation(DiscreteContactApproximation.kTamsi)
    parser = Parser(plant)
    parser.AddModels(model("panda"))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("panda_link0"))
    if which == "contact":
        parser.AddModels(model("microwave"))
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("mw_base"), RigidTransform(SCENE["microwave_xyz"]))
    plant.Finalize()
    whole = builder.Build() if which == "contact" else plant
    simulator = Simulator(whole)
    q, v, tau = ([*part, *[0.0] * (plant.num_positions() - 9)] for part in start(which))

    def settle():
        context = simulator.get_mutable_context()
        context.SetTime(0.0)
        own = plant.GetMyMutableContextFromRoot(context)
        plant.SetPositions(own, np.array(q))
        plant.SetVelocities(own, np.array(v))
        plant.get_applied_generalized_force_input_port().FixValue(own, np.array(tau))
        simulator.Initialize()
        simulator.AdvanceTo(50 * DT if which == "contact" else 0.0)

    try:
        row(name, 100, lambda: simulator.AdvanceTo(simulator.get_context().get_time() + 100 * DT), settle)
    except RuntimeError as error:
        failed(name, error)
