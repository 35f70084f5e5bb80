"""Franka's Panda ("fer") arm and hand, from Franka's parameter files, as one flat URDF.

Franka publishes the parameters as YAML and the URDF as xacro; this reads the YAML. Names are the customary panda_*.
The published collision meshes are convex hulls of the links. They are shown as they are; what touches is a few
capsules and boxes around them, which planning can check quickly. `fit_report` measures how well those fit.
"""

import os
import random
import shutil

from common import *

WHITE, GREY, DARK = (0.92, 0.92, 0.9, 1), (0.35, 0.35, 0.37, 1), (0.15, 0.15, 0.16, 1)

# Capsules as (end, end, radius) in the link's frame, m: found by fit_capsules.py around the published hulls, then grown
# until no point of the hull is more than 1 mm outside. Round ends on flat-ended links cost up to 25 mm; see `fit_report`.
CAPSULES = {
    "link1": [((0.0, -0.0538, -0.0017), (0.0, -0.0002, -0.1371), 0.077), ((-0.0454, 0.0026, 0.0205), (0.0233, 0.0012, 0.0438), 0.01)],
    "link2": [((0.0, -0.1394, 0.0), (0.0, -0.0144, 0.059), 0.077), ((0.0001, -0.0015, 0.0355), (0.0, -0.0053, 0.0363), 0.066)],
    "link3": [((0.0102, 0.0053, -0.0657), (0.0, 0.0002, -0.0733), 0.0722), ((0.0386, 0.0199, -0.0457), (0.0786, 0.0414, -0.0034), 0.0722)],
    "link4": [((-0.0321, 0.0391, 0.0454), (-0.0455, 0.0501, 0.0387), 0.055), ((-0.0008, 0.0074, 0.041), (-0.0825, 0.074, 0.0), 0.0737)],
    "link5": [
        ((-0.0081, 0.0462, -0.1667), (0.0157, 0.0261, -0.0567), 0.0503),
        ((-0.0002, 0.0813, 0.0036), (0.0029, 0.0366, -0.1867), 0.0543),
        ((0.0, 0.0002, -0.2125), (0.0001, 0.0572, -0.0117), 0.0732),
    ],
    "link6": [
        ((0.0829, -0.004, 0.0015), (0.0762, 0.0171, 0.0028), 0.07),
        ((0.0069, -0.002, 0.0116), (0.0512, 0.0102, 0.002), 0.0622),
        ((-0.0384, 0.016, -0.0075), (0.0341, -0.0344, 0.0433), 0.015),
    ],
    "link7": [
        ((-0.0068, -0.0028, 0.0762), (-0.0015, -0.0096, 0.078), 0.0489),
        ((0.026, 0.0199, 0.0796), (0.0023, 0.0063, 0.0794), 0.0506),
        ((0.0366, 0.0684, 0.0855), (0.0683, 0.0379, 0.0856), 0.0156),
    ],
}
# Boxes as (least corner, greatest corner, name): the hull's extents over slices of its height.
BOXES = {
    "link0": [
        ((-0.1541, -0.0947, 0.0), (0.0716, 0.0947, 0.035), "foot"),
        ((-0.1374, -0.0863, 0.035), (0.0674, 0.0863, 0.07), "middle"),
        ((-0.1148, -0.0766, 0.07), (0.0632, 0.0766, 0.105), "shoulder"),
        ((-0.0843, -0.0658, 0.105), (0.059, 0.0658, 0.14), "neck"),
    ],
    "hand": [
        ((-0.0316, -0.104, -0.0075), (0.0316, 0.1004, 0.033), "body"),
        ((-0.0248, -0.1021, 0.033), (0.0248, 0.1004, 0.066), "jaw"),
        ((-0.0264, -0.1038, -0.018), (0.0264, 0.0782, -0.0075), "back"),
        ((-0.0123, -0.0981, -0.026), (0.0123, 0.0067, -0.018), "plug"),
    ],
}
# One finger, in its own frame: y = 0 is the gripping surface. The pad is where things are held.
FINGER = [
    box((0.018, 0.008, 0.018), (0, 0.004, 0.045), name="pad"),
    box((0.021, 0.013, 0.036), (0, 0.0145, 0.036), name="finger"),
    box((0.021, 0.026, 0.018), (0, 0.013, 0.009), name="carriage"),
]
FINGER_ORIGIN_Z = 0.0584
TCP_Z = 0.1034
FLANGE_TO_HAND_YAW = -math.pi / 4

# A depth camera of the size of a RealSense D435 (90 mm x 25 mm x 25 mm, 72 g), on a bracket at the hand's +x side. Its
# optical axis leans towards the fingers, so that the pads just stand in the picture's lower edge.
CAMERA_SIZE, CAMERA_MASS = (0.025, 0.09, 0.025), 0.072
CAMERA_XYZ, CAMERA_LEAN = (0.06, 0, 0.045), 0.25


def read_parameters(path):
    """Franka's parameter files: nested maps of numbers by indentation, and one alias. Not YAML at large."""
    root, stack, anchors = {}, [], {}
    stack.append((-1, root))
    for line in open(path):
        line = line.split("#")[0].rstrip()
        if not line.strip():
            continue
        indent = len(line) - len(line.lstrip())
        key, _, value = line.strip().partition(":")
        value = value.strip()
        while stack[-1][0] >= indent:
            stack.pop()
        here = stack[-1][1]
        if value.startswith("*"):
            here[key] = anchors[value[1:]]
        elif not value or value.startswith("&"):
            here[key] = {}
            if value:
                anchors[value[1:]] = here[key]
            stack.append((indent, here[key]))
        else:
            numbers = [float(x) for x in value.split()]
            here[key] = numbers[0] if len(numbers) == 1 else tuple(numbers)
    return root


def inertial_of(p):
    i = p["inertia"]
    I = ((i["xx"], i["xy"], i["xz"]), (i["xy"], i["yy"], i["yz"]), (i["xz"], i["yz"], i["zz"]))
    return p["mass"], p["origin"]["xyz"], I


def collisions_of(link):
    if link in BOXES:
        return [box(sub(hi, lo), mul(add(lo, hi), 0.5), name=n) for lo, hi, n in BOXES[link]]
    return [capsule_between(a, b, r, name=f"hull_{i}") for i, (a, b, r) in enumerate(CAPSULES[link])]


def convert(assets, staged):
    franka = os.path.join(assets, "franka")
    fer = os.path.join(franka, "robots", "fer")
    kinematics, inertials, limits, dynamics = (
        read_parameters(os.path.join(fer, n + ".yaml")) for n in ("kinematics", "inertials", "joint_limits", "dynamics")
    )
    hand = read_parameters(os.path.join(franka, "end_effectors", "franka_hand", "inertials.yaml"))
    os.makedirs(os.path.join(staged, "meshes"))
    for name in [f"link{i}" for i in range(8)] + ["hand"]:
        source = os.path.join(franka, "meshes", "robot_arms", "fer", "collision", name + ".stl")
        shutil.copyfile(source, os.path.join(staged, "meshes", name + ".stl"))

    parts = []
    for i in range(8):
        link = f"link{i}"
        parts.append(link_element(f"panda_{link}", inertial_of(inertials[link]), [(mesh(f"meshes/{link}.stl"), WHITE)], collisions_of(link)))
        if i == 0:
            continue
        k, l, d = kinematics[f"joint{i}"]["kinematic"], limits[f"joint{i}"]["limit"], dynamics[f"joint{i}"]["dynamic"]
        parts.append(
            joint_element(
                f"panda_joint{i}", "revolute", f"panda_link{i - 1}", f"panda_{link}",
                (k["x"], k["y"], k["z"]), (k["roll"], k["pitch"], k["yaw"]), (0, 0, 1),
                (l["lower"], l["upper"], l["velocity"], l["effort"]), (d["damping"], d["friction"]),
            )
        )
    k = kinematics["joint8"]["kinematic"]
    parts.append(link_element("panda_link8"))
    parts.append(joint_element("panda_joint8", "fixed", "panda_link7", "panda_link8", (k["x"], k["y"], k["z"])))
    parts.append(link_element("panda_hand", inertial_of(hand["hand"]), [(mesh("meshes/hand.stl"), WHITE)], collisions_of("hand")))
    parts.append(joint_element("panda_hand_joint", "fixed", "panda_link8", "panda_hand", rpy=(0, 0, FLANGE_TO_HAND_YAW)))
    for side, joint, yaw in (("left", 1, 0), ("right", 2, math.pi)):
        shapes = [(dict(s, name=None), DARK if s["name"] == "pad" else GREY) for s in FINGER]
        parts.append(link_element(f"panda_{side}finger", inertial_of(hand[side + "finger"]), shapes, FINGER))
        parts.append(
            joint_element(
                f"panda_finger_joint{joint}", "prismatic", "panda_hand", f"panda_{side}finger",
                (0, 0, FINGER_ORIGIN_Z), (0, 0, yaw), (0, 1, 0), (0, 0.04, 0.2, 70), (0, 0),
            )
        )
    body = box(CAMERA_SIZE, name="camera")
    parts.append(link_element("wrist_camera", mass_properties([(body, CAMERA_MASS)]), [(dict(body, name=None), DARK)], [body]))
    parts.append(joint_element("wrist_camera_mount", "fixed", "panda_hand", "wrist_camera", CAMERA_XYZ, (0, -CAMERA_LEAN, 0)))
    with open(os.path.join(staged, "object.urdf"), "w") as f:
        f.write(robot_element("panda", parts, "Made by world-models/convert from franka_description's parameters of the fer (Apache-2.0)"))
    with open(os.path.join(staged, "model.yaml"), "w") as f:
        f.write(document())
    os.makedirs(os.path.join(staged, "evidence"))
    with open(os.path.join(staged, "evidence", "collision_fit.txt"), "w") as f:
        f.write(fit_report(assets) + "\n")


def document():
    # The optical axes are x right, y down, z forward; the camera body's z looks ahead and its x is the picture's up. The
    # optical centre lies on the front face, just outside the body.
    lean = rotation_of((0, -CAMERA_LEAN, 0))
    R = matmul(lean, ((0, -1, 0), (1, 0, 0), (0, 0, 1)))
    p = add(CAMERA_XYZ, matvec(lean, (0, 0, CAMERA_SIZE[2] / 2 + 0.001)))
    width, height, field = 160, 120, math.radians(87)
    focal = width / 2 / math.tan(field / 2)
    text = DOCUMENT
    for key, value in {
        "CAMERA_XYZ": ", ".join(number(x, 6) for x in p),
        "CAMERA_RPY": ", ".join(number(x, 12) for x in rpy_of(R)),
        "FOCAL": number(focal, 3),
        "TCP_Z": number(TCP_Z),
    }.items():
        text = text.replace("{" + key + "}", value)
    return text


DOCUMENT = """\
schema: 1
name: panda
description: Franka's seven-jointed Panda arm with its two-finger hand and a depth camera on the hand.
category: robot
movable: false
robot:
  arm_joints: [panda_joint1, panda_joint2, panda_joint3, panda_joint4, panda_joint5, panda_joint6, panda_joint7]
  gripper:
    link: panda_hand
    X_LT: {xyz: [0, 0, {TCP_Z}], rpy: [0, 0, 0]}
    # The hand has one motor: both fingers move together, each by half of the width.
    fingers:
      - {joint: panda_finger_joint1, link: panda_leftfinger}
      - {joint: panda_finger_joint2, link: panda_rightfinger}
    max_width: 0.08
    max_force: 70
    pad_half_extents: [0.009, 0.009]
  camera:
    link: panda_hand
    X_LC: {xyz: [{CAMERA_XYZ}], rpy: [{CAMERA_RPY}]}
    size: [160, 120]
    # 87 degrees from side to side, as the D435's depth camera has.
    focal: [{FOCAL}, {FOCAL}]
    center: [79.5, 59.5]
    range: [0.12, 2.0]
  wrist_link: panda_hand
  configurations:
    - {name: ready, q: [0, -0.785, 0, -2.356, 0, 1.571, 0.785]}
    # From about 0.62 m above the table, ahead, to the left and to the right.
    - {name: look_ahead, q: [0, -1.385, 0, -2.851, 0, 2.429, 0.785]}
    - {name: look_left, q: [0.364, -1.323, 0.263, -2.775, 0.25, 2.364, 0.793]}
    - {name: look_right, q: [-0.364, -1.323, -0.263, -2.775, -0.25, 2.364, 0.777]}
    # From farther ahead, steeply down: into what stands open.
    - {name: look_down, q: [0, -0.809, 0, -2.305, 0, 2.062, 0.785]}
surface_friction: 0.8
provenance:
  licence: Apache-2.0
  attribution: "franka_description, Copyright 2023 Franka Robotics GmbH (LICENSE, NOTICE)"
  origins:
    - source: https://github.com/frankarobotics/franka_description
      version: 566ba44abc48be2fca16050c406562e22f85793b
  changes:
    - "Written as a flat URDF from the parameter files of the fer and of the Franka hand; its joint8 is the fixed joint to the flange"
    - "Inertias are the published ones; the principal moments of link 4 break the triangle inequality by 9.5 %"
    - "Collision shapes are capsules and boxes around the published hulls, which are shown as they are"
    - "The fingers' shapes are boxes of our own after the hand's dimensions; the second finger does not mimic the first"
    - "The wrist camera is our own addition"
"""


def distance_to_segment(p, a, b):
    d = sub(b, a)
    t = max(0.0, min(1.0, dot(sub(p, a), d) / max(dot(d, d), 1e-18)))
    return norm(sub(p, add(a, mul(d, t))))


def depth_outside(link, p):
    """How far a point of the hull sticks out of the link's collision shapes, m (negative: inside)."""
    if link in BOXES:
        return min(norm(tuple(max(l - x, 0, x - h) for l, x, h in zip(lo, p, hi))) for lo, hi, _ in BOXES[link])
    return min(distance_to_segment(p, a, b) - r for a, b, r in CAPSULES[link])


def surface_of(link, rng, count):
    """Points on the surfaces of the link's collision shapes, less what lies inside another of them."""
    points = []
    if link in BOXES:
        for lo, hi, _ in BOXES[link]:
            for _ in range(count):
                p = [rng.uniform(l, h) for l, h in zip(lo, hi)]
                k = rng.randrange(3)
                p[k] = rng.choice((lo[k], hi[k]))
                points.append(tuple(p))
        return points
    for i, (a, b, r) in enumerate(CAPSULES[link]):
        others = [c for j, c in enumerate(CAPSULES[link]) if j != i]
        along = sub(b, a)
        straight = norm(along) / (norm(along) + 2 * r)  # the side's share of the area
        for _ in range(count):
            d = tuple(rng.gauss(0, 1) for _ in range(3))
            if rng.random() < straight:
                t = rng.random()
                d = sub(d, mul(along, dot(d, along) / dot(along, along)))
            else:
                t = 1.0 if dot(d, along) > 0 else 0.0
            p = add(add(a, mul(along, t)), mul(unit(d), r))
            if all(distance_to_segment(p, c, e) >= s for c, e, s in others):
                points.append(p)
    return points


def fit_report(assets):
    """For each link: how far its published hull sticks out of the shapes, and the shapes out of the hull, mm."""
    rng = random.Random(1)
    lines = ["link   shapes  hull outside shapes, max mm   shapes outside hull, mean mm   max mm"]
    for link in [f"link{i}" for i in range(8)] + ["hand"]:
        hull = read_stl(os.path.join(assets, "franka", "meshes", "robot_arms", "fer", "collision", link + ".stl"))
        areas = [norm(cross(sub(b, a), sub(c, a))) for a, b, c in hull]
        points = [p for t in hull for p in t]
        for _ in range(3000):
            a, b, c = rng.choices(hull, areas)[0]
            u, v = sorted((rng.random(), rng.random()))
            points.append(tuple(a[k] * u + b[k] * (v - u) + c[k] * (1 - v) for k in range(3)))
        missed = max(depth_outside(link, p) for p in points)
        planes = [(unit(n), a) for a, n in ((a, cross(sub(b, a), sub(c, a))) for a, b, c in hull) if norm(n) > 1e-12]
        over = [max(0.0, max(dot(n, sub(p, a)) for n, a in planes)) for p in surface_of(link, rng, 300)]
        count = len(BOXES.get(link) or CAPSULES[link])
        lines.append(f"{link:6} {count:6} {max(0, missed) * 1000:29.1f} {sum(over) / len(over) * 1000:30.1f} {max(over) * 1000:8.1f}")
    return "\n".join(lines)
