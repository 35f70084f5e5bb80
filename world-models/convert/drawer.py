"""Meta-World's drawer (MJCF) to URDF, at the source's own size.

Inside it is 0.168 m by 0.148 m, and 0.104 m deep. A Panda's hand, 0.204 m long, does not go in there: it takes what stands
up to near the drawer's edge. The bar lies 0.09 m above the table, so that the hand comes to it from above, at a slant.
"""

import os

from common import *

BEIGE, WHITE = (0.76, 0.68, 0.55, 1), (0.75, 0.75, 0.75, 1)
SCALE = 1.0
CASE_Z = 0.084  # the case's frame above the ground
DRAWER = (0, -0.01, 0.006)  # the drawer's frame in the case's
SLIDE = 0.16

CASE = [
    ("left", (-0.11, 0, 0), (0.008, 0.1, 0.084)),
    ("right", (0.11, 0, 0), (0.008, 0.1, 0.084)),
    ("back", (0, 0.092, -0.008), (0.102, 0.008, 0.076)),
    ("floor", (0, -0.008, -0.07), (0.102, 0.092, 0.014)),
    ("top", (0, 0, 0.076), (0.102, 0.1, 0.008)),
]
BOX = [
    ("front", (0, -0.082, 0.008), (0.1, 0.008, 0.052)),
    ("rear", (0, 0.082, 0.008), (0.1, 0.008, 0.052)),
    ("left", (-0.092, 0, 0.008), (0.008, 0.074, 0.052)),
    ("right", (0.092, 0, 0.008), (0.008, 0.074, 0.052)),
    ("floor", (0, 0, -0.052), (0.1, 0.09, 0.008)),
]


def convert(assets, staged):
    source = os.path.join(assets, "metaworld", "objects", "meshes", "drawer")
    os.makedirs(os.path.join(staged, "meshes"))
    for name in ("drawercase", "drawer", "drawerhandle"):
        write_stl(os.path.join(staged, "meshes", name + ".stl"), transform(read_stl(os.path.join(source, name + ".stl")), scale=SCALE))

    scaled = lambda parts, shift=(0, 0, 0): [box(mul(h, 2 * SCALE), mul(add(p, shift), SCALE), name=n) for n, p, h in parts]
    lift = (0, 0, CASE_Z)
    case = scaled(CASE, lift)
    drawer = scaled(BOX)
    across = (math.pi / 2, 0, 0)
    posts = [
        capsule(0.009 * SCALE, 0.06 * SCALE, mul((x, -0.12, 0), SCALE), across, name=n)
        for x, n in ((-0.05, "handle_left_post"), (0.05, "handle_right_post"))
    ]
    bar = capsule(0.009 * SCALE, 0.1 * SCALE, mul((0, -0.15, 0), SCALE), (0, math.pi / 2, 0), name="handle")
    grow = SCALE**3
    parts = [
        link_element(
            "cabinet",
            mass_properties([(s, 0.05 * grow) for s in case]),
            [(mesh("meshes/drawercase.stl", mul(lift, SCALE)), BEIGE)],
            case,
        ),
        link_element(
            "drawer",
            mass_properties([(s, 0.04 * grow) for s in drawer] + [(s, 0.06 * grow) for s in [bar] + posts]),
            [(mesh("meshes/drawer.stl"), BEIGE), (mesh("meshes/drawerhandle.stl", mul((0, -0.114, 0), SCALE)), WHITE)],
            drawer + [bar] + posts,
        ),
        # The MJCF slides along +y from 0 to -0.16; here the axis is reversed, so that opening is positive.
        joint_element(
            "drawer_slide", "prismatic", "cabinet", "drawer", mul(add(DRAWER, lift), SCALE), axis=(0, -1, 0),
            limit=(0, SLIDE * SCALE, 10, 1000), dynamics=(2, 3),
        ),
    ]
    with open(os.path.join(staged, "object.urdf"), "w") as f:
        f.write(robot_element("drawer", parts, "Made by world-models/convert from Meta-World's drawer (MIT)"))
    with open(os.path.join(staged, "model.yaml"), "w") as f:
        f.write(DOCUMENT)


DOCUMENT = """\
schema: 1
name: drawer
description: A small cabinet with one drawer that has a level bar handle.
category: drawer
movable: false
grasps:
  # The straight part between the posts, in the drawer's frame.
  - kind: bar
    name: handle
    link: drawer
    from: [-0.033, -0.15, 0]
    to: [0.033, -0.15, 0]
    radius: 0.009
    outward: [0, -1, 0]
    swing: 1.0
    # From the bar's centre line to the drawer's front, which lies at y = -0.09.
    depth: 0.06
regions:
  # Between the inner faces of the drawer's collision boxes, up to their upper edge.
  - name: drawer
    link: drawer
    center: [0, 0, 0.008]
    size: [0.168, 0.148, 0.104]
    opening: [0, 0, 1]
surface_friction: 0.7
provenance:
  licence: MIT
  attribution: "Meta-World, Copyright (c) 2019 Meta-World Team (LICENSE)"
  origins:
    - source: "PyPI metaworld, metaworld/assets/objects/assets/drawer.xml"
      version: 3.1.1
  changes:
    - "MJCF written as URDF"
    - "The slide's axis is reversed, so that the drawer opens in the positive direction"
    - "Damping is the source's 2 N s/m; dry friction of 3 N is our own estimate, in the range of 2 to 10 N that wooden drawers have"
    - "The handle is turned by 90 degrees; the source rounds to 1.57 rad"
    - "The joint's armature of 0.001 kg is left out; colours are our own"
    - "The URDF's limits of speed and effort are our own, far from what the arm can do"
"""
