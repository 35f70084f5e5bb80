"""Times Nimble: steps, its analytic derivatives, and gradients of rollouts. Needs numpy below 2."""
import importlib.metadata
import pathlib
import re
import tempfile

import nimblephysics as nimble
import numpy as np
import torch
from peer_timing import DT, SCENE, model, row, start, version

torch.set_num_threads(1)
version(f"Nimble {importlib.metadata.version('nimblephysics')}")


def fixed(name, xyz):
    """A copy whose base hangs on a link called world; the base would float otherwise."""
    text = pathlib.Path(model(name)).read_text()
    root = re.search(r'<link name="([^"]+)"', text).group(1)
    weld = f'<link name="world"/><joint name="weld" type="fixed"><parent link="world"/><child link="{root}"/>'
    weld += f'<origin xyz="{xyz[0]} {xyz[1]} {xyz[2]}"/></joint></robot>'
    path = pathlib.Path(tempfile.mkdtemp()) / f"{name}.urdf"
    path.write_text(text.replace("</robot>", weld))
    return str(path)


for which, count, gradient in (("free", 1000, "1,000 free steps + gradient"), ("contact", 300, "300 gripping steps + gradient")):
    world = nimble.simulation.World()
    world.setGravity(SCENE["gravity"])
    world.setTimeStep(DT)
    skeletons = [world.loadSkeleton(fixed("panda", (0, 0, 0)))]
    if which == "contact":
        skeletons.append(world.loadSkeleton(fixed("microwave", SCENE["microwave_xyz"])))
    for skeleton in skeletons:
        for k in range(skeleton.getNumBodyNodes()):
            skeleton.getBodyNode(k).setFrictionCoeff(SCENE["friction"])
    q, v, tau = (np.array([*part, *[0.0] * (world.getNumDofs() - 9)]) for part in start(which))

    def put():
        world.setPositions(q)
        world.setVelocities(v)
        world.setCachedLCPSolution(np.zeros(0))

    def steps(n):
        for _ in range(n):
            world.setAction(tau)
            world.step()

    def settle():
        put()
        steps(50 if which == "contact" else 0)

    def derivatives():
        world.setAction(tau)
        taken = nimble.neural.forwardPass(world, True)
        return taken.getStateJacobian(world), taken.getActionJacobian(world)

    def rollout():
        put()
        action = torch.tensor(tau, requires_grad=True)
        state = torch.tensor(np.concatenate([q, v]), requires_grad=True)
        x = state
        for _ in range(count):
            x = nimble.timestep(world, x, action)
        (0.5 * (x[:7] ** 2).sum()).backward()

    row("free step" if which == "free" else "gripping step, 8 contacts", 50, lambda: steps(50), settle)
    settle()
    row("free step + A, B" if which == "free" else "gripping step + A, B", 1, derivatives)
    row(gradient, 1, rollout)
