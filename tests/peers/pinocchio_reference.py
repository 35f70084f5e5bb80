#!/usr/bin/env python3
"""Reference figures of rigid-body dynamics, made by Pinocchio, for the tests of kernel/dynamics.

    pip install pin==4.1.0
    python tests/peers/pinocchio_reference.py URDF FRAME OUT.json [--states 200] [--seed 1]

At random states: inverse dynamics, forward dynamics, the upper triangle of the mass matrix by rows, gravity, and the
Jacobian of FRAME's origin (angular rows first, world axes). Joints that mimic another one follow it: the full tree's
figures are projected on the joints that move on their own. Positions of revolute and prismatic joints lie within the
limits, velocities and accelerations within +-2 and +-5, efforts within +-20.
"""

import argparse
import json
import sys
import xml.etree.ElementTree as xml

import numpy as np
import pinocchio as pin

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("urdf")
parser.add_argument("frame")
parser.add_argument("out")
parser.add_argument("--states", type=int, default=200)
parser.add_argument("--seed", type=int, default=1)
args = parser.parse_args()

model = pin.buildModelFromUrdf(args.urdf)
model.gravity.linear = np.array([0.0, 0.0, -9.81])
data = model.createData()
if not model.existFrame(args.frame):
    sys.exit(f"{args.urdf} has no link '{args.frame}'")
frame = model.getFrameId(args.frame)

# Followers: q = multiplier * q(leader) + offset.
mimic = {}
for joint in xml.parse(args.urdf).getroot().findall("joint"):
    follows = joint.find("mimic")
    if follows is not None:
        mimic[joint.get("name")] = (
            follows.get("joint"),
            float(follows.get("multiplier", "1")),
            float(follows.get("offset", "0")),
        )
names = [n for n in model.names[1:]]
free = [n for n in names if n not in mimic]
if any(model.joints[model.getJointId(n)].nq != 1 for n in names):
    sys.exit("only joints of one degree of freedom with one position are handled")

# v_full = G v, q_full = G q + offset
G = np.zeros((model.nv, len(free)))
offset = np.zeros(model.nq)
for n in names:
    row = model.joints[model.getJointId(n)].idx_v
    leader, multiplier, shift = mimic.get(n, (n, 1.0, 0.0))
    G[row, free.index(leader)] = multiplier
    offset[row] = shift

rng = np.random.default_rng(args.seed)
lower = np.array([max(model.lowerPositionLimit[model.joints[model.getJointId(n)].idx_q], -3.0) for n in free])
upper = np.array([min(model.upperPositionLimit[model.joints[model.getJointId(n)].idx_q], 3.0) for n in free])


def numbers(values):
    """13 digits: far below the bound of the comparison."""
    return [float(f"{x:.12e}") for x in np.asarray(values).ravel()]


def coarse(values):
    """Inputs are rounded first, so that they are exact in the file."""
    return np.round(values, 6)


states = []
for _ in range(args.states):
    n = len(free)
    q = coarse(rng.uniform(lower, upper))
    v = coarse(rng.uniform(-2.0, 2.0, n))
    a = coarse(rng.uniform(-5.0, 5.0, n))
    tau = coarse(rng.uniform(-20.0, 20.0, n))
    q_full, v_full = G @ q + offset, G @ v
    inverse = G.T @ pin.rnea(model, data, q_full, v_full, G @ a)
    bias = G.T @ pin.nonLinearEffects(model, data, q_full, v_full)
    gravity = G.T @ pin.computeGeneralizedGravity(model, data, q_full)
    M_full = pin.crba(model, data, q_full)
    M_full = np.triu(M_full) + np.triu(M_full, 1).T
    M = G.T @ M_full @ G
    # The articulated-body algorithm where the tree has no followers, so that the two ways are independent.
    forward = np.linalg.solve(M, tau - bias) if mimic else pin.aba(model, data, q_full, v_full, tau)
    pin.computeJointJacobians(model, data, q_full)
    pin.updateFramePlacements(model, data)
    J = pin.getFrameJacobian(model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED) @ G
    J = np.vstack([J[3:], J[:3]])
    states.append(
        {
            "q": q.tolist(),
            "v": v.tolist(),
            "a": a.tolist(),
            "tau": tau.tolist(),
            "inverse": numbers(inverse),
            "forward": numbers(forward),
            "gravity": numbers(gravity),
            "mass": numbers(M[np.triu_indices(n)]),
            "jacobian": numbers(J),
        }
    )

head = {
    "by": f"pinocchio {pin.__version__}",
    "robot": model.name,
    "frame": args.frame,
    "gravity": [0.0, 0.0, -9.81],
    "joints": free,
}
with open(args.out, "w", encoding="utf-8") as file:
    # One state a line.
    file.write(json.dumps(head)[:-1] + ', "states": [\n')
    file.write(",\n".join(json.dumps(s, separators=(",", ":")) for s in states))
    file.write("\n]}\n")
