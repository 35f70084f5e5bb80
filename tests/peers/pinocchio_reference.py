#!/usr/bin/env python3
"""Reference figures of rigid-body dynamics, made by Pinocchio, for the tests of kernel/dynamics.

    pip install pin==4.1.0
    python tests/peers/pinocchio_reference.py

Writes `NAME_pinocchio.json` beside this file for the arm, the microwave and the drawer cabinet that ship, and for
`mixed.urdf`, a tree with a floating, a planar, prismatic and turning joints and a follower.

At each random state: inverse and forward dynamics and gravity; and of the mass matrix, the derivatives of inverse and
forward dynamics by position, velocity and effort, and the torque regressor, the product with the vector x_j = cos(j): an
error in any entry shows in it. The first states have all matrices in full, and the Jacobian of one link's origin.

Joints that mimic another one follow it: the full tree's figures are projected on the joints that move on their own.
Everything is written in this project's order: a floating joint's q is the quaternion (w, x, y, z) and then the position, its
v and efforts are angular and then linear; angular rows of a Jacobian come first; a body's inertia is m, m c, and the
rotational inertia about the link's origin (xx, xy, xz, yy, yz, zz). A planar joint is given by x, y and the angle; its
normal must be z, for Pinocchio knows no other.
"""

import argparse
import json
import pathlib
import sys
import xml.etree.ElementTree as xml

import numpy as np
import pinocchio as pin

HERE = pathlib.Path(__file__).resolve().parent
MODELS = HERE.parent.parent / "world-models"


def shipped(name):
    return MODELS / name / (MODELS / name / "HEAD").read_text().strip() / "object.urdf"


SCENES = {
    "panda": (shipped("panda"), "panda_hand"),
    "microwave": (shipped("microwave"), None),
    "drawer": (shipped("drawer"), None),
    "mixed": (HERE / "mixed.urdf", "tool"),
}
# Pinocchio's order of the ten inertial numbers: xx, xy, yy, xz, yz, zz.
ENTRIES = [0, 1, 2, 3, 4, 5, 7, 6, 8, 9]

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--states", type=int, default=500)
parser.add_argument("--full", type=int, default=10)
parser.add_argument("--seed", type=int, default=1)
args = parser.parse_args()


def numbers(values):
    """13 digits: far below the bound of the comparison."""
    return [float(f"{x:.12e}") for x in np.asarray(values).ravel()]


def coarse(values):
    """Inputs are rounded first, so that they are exact in the file."""
    return np.round(values, 4)


def reference(name, urdf, frame_name):
    model = pin.buildModelFromUrdf(str(urdf))
    model.gravity.linear = np.array([0.0, 0.0, -9.81])
    data = model.createData()
    frame_name = frame_name or model.frames[-1].name
    frame = model.getFrameId(frame_name)
    tree = xml.parse(urdf).getroot()
    mimic, links = {}, {}
    for joint in tree.findall("joint"):
        links[joint.get("name")] = joint.find("child").get("link")
        follows = joint.find("mimic")
        if follows is not None:
            mimic[joint.get("name")] = (
                follows.get("joint"),
                float(follows.get("multiplier", "1")),
                float(follows.get("offset", "0")),
            )
    names = list(model.names[1:])
    free = [n for n in names if n not in mimic]
    joints = {n: model.joints[model.getJointId(n)] for n in names}

    # v_full = G v, in Pinocchio's order on the left and ours on the right, where a floating joint turns first.
    at, n = {}, 0
    for joint in free:
        at[joint] = n
        n += joints[joint].nv
    G = np.zeros((model.nv, n))
    for joint in names:
        row, size = joints[joint].idx_v, joints[joint].nv
        leader, multiplier, _ = mimic.get(joint, (joint, 1.0, 0.0))
        for k in range(size):
            G[row + k, at[leader] + (k + 3) % 6 if size == 6 else at[leader] + k] = multiplier

    def full(q):
        """Our positions, joint by joint, as Pinocchio's."""
        q_full = np.zeros(model.nq)
        for joint in names:
            own = q[mimic.get(joint, (joint,))[0]]
            to = slice(joints[joint].idx_q, joints[joint].idx_q + joints[joint].nq)
            kind = joints[joint].shortname()
            if joint in mimic:
                q_full[to] = mimic[joint][1] * own[0] + mimic[joint][2]
            elif kind == "JointModelFreeFlyer":
                q_full[to] = [*own[4:], *own[1:4], own[0]]
            elif kind == "JointModelPlanar":
                q_full[to] = [own[0], own[1], np.cos(own[2]), np.sin(own[2])]
            elif joints[joint].nq == 1:
                q_full[to] = own
            elif joints[joint].nq == 2:
                q_full[to] = [np.cos(own[0]), np.sin(own[0])]
            else:
                sys.exit(f"{joint}: a {kind} is not handled")
        return q_full

    def positions(rng):
        q = {}
        for joint in free:
            kind, j = joints[joint].shortname(), joints[joint]
            if kind == "JointModelFreeFlyer":
                turn = rng.normal(size=4)
                q[joint] = np.concatenate([turn / np.linalg.norm(turn), coarse(rng.uniform(-1.0, 1.0, 3))])
            elif kind == "JointModelPlanar":
                q[joint] = coarse(rng.uniform([-1, -1, -3], [1, 1, 3]))
            elif j.nq == 2:
                q[joint] = coarse(rng.uniform(-3.0, 3.0, 1))
            else:
                lower, upper = model.lowerPositionLimit[j.idx_q], model.upperPositionLimit[j.idx_q]
                q[joint] = coarse(rng.uniform(max(lower, -3.0), min(upper, 3.0), 1))
        return q

    rng = np.random.default_rng(args.seed)
    x = np.cos(np.arange(n))
    x_pi = np.cos(np.arange(10 * len(names)))
    states = []
    for s in range(args.states):
        q = positions(rng)
        v, a = coarse(rng.uniform(-2.0, 2.0, n)), coarse(rng.uniform(-5.0, 5.0, n))
        tau = coarse(rng.uniform(-20.0, 20.0, n))
        q_full, v_full, a_full = full(q), G @ v, G @ a
        M = pin.crba(model, data, q_full)
        M = G.T @ (np.triu(M) + np.triu(M, 1).T) @ G
        bias = G.T @ pin.nonLinearEffects(model, data, q_full, v_full)
        # The articulated-body algorithm where the tree has no followers, so that the two ways are independent.
        if mimic:
            forward = np.linalg.solve(M, tau - bias)
        else:
            forward = G.T @ pin.aba(model, data, q_full, v_full, G @ tau)
        inverse = G.T @ pin.rnea(model, data, q_full, v_full, a_full)
        gravity = G.T @ pin.computeGeneralizedGravity(model, data, q_full)

        def by_state(a_full):
            pin.computeRNEADerivatives(model, data, q_full, v_full, a_full)
            return G.T @ data.dtau_dq @ G, G.T @ data.dtau_dv @ G

        if mimic:
            by_q, by_v = by_state(G @ forward)
            by_tau = np.linalg.inv(M)
            by_q, by_v = -by_tau @ by_q, -by_tau @ by_v
        else:
            pin.computeABADerivatives(model, data, q_full, v_full, G @ tau)
            by_tau = np.triu(data.Minv) + np.triu(data.Minv, 1).T
            by_q, by_v, by_tau = (G.T @ d @ G for d in (data.ddq_dq, data.ddq_dv, by_tau))
        inverse_by_q, inverse_by_v = by_state(a_full)
        # The binding drops a dimension of size one.
        Y = pin.computeJointTorqueRegressor(model, data, q_full, v_full, a_full)
        Y = G.T @ np.reshape(Y, (model.nv, -1))
        Y = np.hstack([Y[:, 10 * k : 10 * k + 10][:, ENTRIES] for k in range(len(names))])
        matrices = {
            "mass": M,
            "inverse_by_q": inverse_by_q,
            "inverse_by_v": inverse_by_v,
            "forward_by_q": by_q,
            "forward_by_v": by_v,
            "forward_by_tau": by_tau,
            "regressor": Y,
        }
        state = {
            "q": np.concatenate([q[joint] for joint in free]).tolist(),
            "v": v.tolist(),
            "a": a.tolist(),
            "tau": tau.tolist(),
            "inverse": numbers(inverse),
            "forward": numbers(forward),
            "gravity": numbers(gravity),
            "products": {k: numbers(m @ (x_pi if k == "regressor" else x)) for k, m in matrices.items()},
        }
        if s < args.full:
            pin.computeJointJacobians(model, data, q_full)
            pin.updateFramePlacements(model, data)
            J = pin.getFrameJacobian(model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            J = np.reshape(J, (6, -1)) @ G
            matrices["jacobian"] = np.vstack([J[3:], J[:3]])
            # Row by row.
            state["matrices"] = {k: numbers(m) for k, m in matrices.items()}
        states.append(state)

    head = {
        "by": f"pinocchio {pin.__version__}",
        "robot": model.name,
        "frame": frame_name,
        "gravity": [0.0, 0.0, -9.81],
        "joints": free,
        "bodies": [links[joint] for joint in names],
    }
    with open(HERE / f"{name}_pinocchio.json", "w", encoding="utf-8") as file:
        # One state a line.
        file.write(json.dumps(head)[:-1] + ', "states": [\n')
        file.write(",\n".join(json.dumps(s, separators=(",", ":")) for s in states))
        file.write("\n]}\n")


for name, (urdf, frame_name) in SCENES.items():
    reference(name, urdf, frame_name)
