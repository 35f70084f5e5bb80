"""The YCB mug (025_mug, a scan of a real one) as a clean solid with the scan's measures.

The scanner could not see the bottom of the mug: inside, the scan closes with a false cone. So the body is a solid of
revolution whose outer radii are medians of the scan's points at each height, with a wall as thick as the scan shows
near the rim; the handle is the scan's own, thinned out.
"""

import os
import random

from common import *

BLUE = (0.2, 0.35, 0.7, 1)
AXIS = (0.0119, 0.00095)  # of the body, in the scan
BOTTOM = -0.0407
HEIGHT = 0.0814
MASS = 0.118
# Outer and inner radius at heights above the bottom, from the scan (see `measure`); the floor's upper face is at FLOOR.
FLOOR = 0.004
WALL_OUT, WALL_IN = 0.0409, 0.0389
LIP_OUT, LIP_BELOW = 0.0466, 0.0779
FOOT = 0.0375
WALLS = 16


def read_obj(path):
    vertices, triangles = [], []
    for line in open(path):
        w = line.split()
        if not w:
            continue
        if w[0] == "v":
            vertices.append(tuple(map(float, w[1:4])))
        elif w[0] == "f":
            i = [int(x.split("/")[0]) - 1 for x in w[1:]]
            triangles += [(i[0], i[k], i[k + 1]) for k in range(1, len(i) - 1)]
    shift = (AXIS[0], AXIS[1], BOTTOM)
    return [sub(v, shift) for v in vertices], triangles


def cluster(vertices, triangles, cell):
    """Vertex clustering: one point a cell, the mean of those in it."""
    key = lambda v: tuple(math.floor(x / cell) for x in v)
    sums = {}
    for i in sorted({i for t in triangles for i in t}):
        s = sums.setdefault(key(vertices[i]), [0, (0, 0, 0)])
        s[0] += 1
        s[1] = add(s[1], vertices[i])
    mean = {k: mul(p, 1 / n) for k, (n, p) in sums.items()}
    out, seen = [], set()
    for t in triangles:
        k = [key(vertices[i]) for i in t]
        if len(set(k)) == 3 and frozenset(k) not in seen:
            seen.add(frozenset(k))
            out.append(tuple(mean[x] for x in k))
    return out


def revolve(profile, segments):
    """A closed solid from a profile of (radius, height) that starts and ends on the axis, seen counter-clockwise."""
    at = lambda r, z, i: (r * math.cos(2 * math.pi * i / segments), r * math.sin(2 * math.pi * i / segments), z)
    triangles = []
    for (r0, z0), (r1, z1) in zip(profile, profile[1:]):
        for i in range(segments):
            j = (i + 1) % segments
            a, b, c, d = at(r0, z0, i), at(r0, z0, j), at(r1, z1, j), at(r1, z1, i)
            if r0 > 0:
                triangles.append((a, b, c))
            if r1 > 0:
                triangles.append((a, c, d))
    return triangles


PROFILE = [
    (0, 0), (FOOT, 0), (0.0396, 0.0045), (WALL_OUT, 0.011), (WALL_OUT, LIP_BELOW - 0.001), (LIP_OUT - 0.0006, LIP_BELOW),
    (LIP_OUT, LIP_BELOW + 0.0008), (LIP_OUT, HEIGHT - 0.0006), (LIP_OUT - 0.0006, HEIGHT), (0.0402, HEIGHT),
    (WALL_IN, HEIGHT - 0.0012), (WALL_IN, 0.012), (0.0376, FLOOR + 0.001), (0.0366, FLOOR), (0, FLOOR),
]

# The handle in the mug's frame: centre, size, turn about y. It stands out to -x.
HANDLE = [
    box((0.0093, 0.0136, 0.039), (-0.0660, -0.0014, 0.0425), name="handle"),
    box((0.0255, 0.0142, 0.0085), (-0.0508, -0.0012, 0.0650), (0, 0.06, 0), name="handle_upper"),
    box((0.0280, 0.0125, 0.0085), (-0.0510, -0.0012, 0.0170), (0, 0.47, 0), name="handle_lower"),
]


def collisions():
    from tape import ring_boxes

    walls = ring_boxes(WALL_OUT, WALL_IN, HEIGHT / 2, HEIGHT, WALLS, "wall")
    lip = ring_boxes(LIP_OUT, WALL_OUT * math.cos(math.pi / WALLS), (HEIGHT + LIP_BELOW) / 2, HEIGHT - LIP_BELOW, WALLS, "lip")
    base = cylinder(0.0388, FLOOR, (0, 0, FLOOR / 2), name="base")
    return walls, lip, base


def convert(assets, staged):
    os.makedirs(os.path.join(staged, "meshes"))
    vertices, triangles = read_obj(os.path.join(assets, "ycb_mug", "textured.obj"))
    beyond = lambda v: math.hypot(v[0], v[1]) > WALL_OUT - 0.0005 and v[0] < -0.036 and abs(v[1]) < 0.0125 and 0.005 < v[2] < LIP_BELOW - 0.0015
    handle = [t for t in triangles if all(beyond(vertices[i]) for i in t)]
    write_stl(os.path.join(staged, "meshes", "body.stl"), revolve(PROFILE, 32))
    write_stl(os.path.join(staged, "meshes", "handle.stl"), cluster(vertices, handle, 0.0022))

    walls, lip, base = collisions()
    solids = walls + lip + [base] + HANDLE
    # One sheet of metal all over: the mass is spread by volume.
    whole = sum(volume(s) for s in solids)
    parts = [
        link_element(
            "mug",
            mass_properties([(s, MASS * volume(s) / whole) for s in solids]),
            [(mesh("meshes/body.stl"), BLUE), (mesh("meshes/handle.stl"), BLUE)],
            solids,
        )
    ]
    with open(os.path.join(staged, "object.urdf"), "w") as f:
        f.write(robot_element("mug", parts, "Made by world-models/convert from the YCB object 025_mug (CC BY 4.0)"))
    with open(os.path.join(staged, "model.yaml"), "w") as f:
        f.write(DOCUMENT)


DOCUMENT = """\
schema: 1
name: mug
description: A metal mug of 93 mm across its rim and 81 mm height, with one handle.
category: mug
movable: true
grasps:
  - kind: rim
    name: rim
    link: mug
    center: [0, 0, 0.0814]
    axis: [0, 0, 1]
    radius: 0.0428
    thickness: 0.0077
    depth: 0.03
    # The handle stands out to -x.
    blocked: [[3.141592653589793, 0.5]]
    tilt: 0.5
  - kind: bar
    name: handle
    link: mug
    from: [-0.0660, -0.0014, 0.028]
    to: [-0.0660, -0.0014, 0.056]
    radius: 0.0068
    outward: [-1, 0, 0]
    swing: 0.4
    # From the bar's centre line to the wall.
    depth: 0.024
surface_friction: 0.6
provenance:
  licence: CC-BY-4.0
  attribution: "YCB Object and Model Set: B. Calli, A. Singh, A. Walsman, S. Srinivasa, P. Abbeel, A. M. Dollar, http://ycb-benchmarks.s3-website-us-east-1.amazonaws.com/"
  origins:
    - source: "YCB Object and Model Set, 025_mug, by https://github.com/yding25/URDF_models, utensil_mug_blue"
      version: 4f5c0f342b202f9aeaec95d53b138d87e213f2c9
  changes:
    - "The body is drawn anew as a solid of revolution with the scan's measures, since the scan closes inside with a false cone; the handle is the scan's, thinned out"
    - "The origin is moved to the middle of the bottom, z up"
    - "Collision shapes are boxes and a cylinder of our own"
    - "Mass 0.118 kg as the data set gives for the real mug, spread evenly over the shell"
"""
