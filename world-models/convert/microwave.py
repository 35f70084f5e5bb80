"""furniture_sim's microwave (MJCF) to URDF.

The masses, the hinge, the damping and the dry friction are the MJCF's; MuJoCo takes a body's inertia from its collision
geoms (`inertiafromgeom`, group 4), and so does this. MuJoCo capsules give half lengths, URDF whole ones.
"""

import os
import shutil

from common import *

BLACK, METAL, WINDOW = (0.2, 0.2, 0.2, 1), (0.75, 0.75, 0.77, 1), (0.4, 0.4, 0.4, 0.25)

# Name, centre, half extents: the walls of the body, in its own frame (z = 0 under the feet, the front looks to -y).
WALLS = [
    ("left", (-0.316, 0.023, 0.187), (0.029, 0.199, 0.187)),
    ("right", (0.236, 0.023, 0.187), (0.109, 0.199, 0.187)),
    ("back", (-0.081, 0.191, 0.187), (0.207, 0.03, 0.187)),
    ("top", (-0.08, -0.007, 0.355), (0.207, 0.169, 0.019)),
    ("floor", (-0.08, -0.008, 0.024), (0.207, 0.168, 0.024)),
    ("panel", (0.26, -0.197, 0.187), (0.085, 0.024, 0.187)),
]
WALL_MASS = 0.5
HINGE = (-0.345, -0.176, 0.192)


def convert(assets, staged):
    source = os.path.join(assets, "furniture_sim", "microwave", "meshes")
    os.makedirs(os.path.join(staged, "meshes"))
    for name in ("micro", "microbutton", "microfeet", "microdoor", "microwindow"):
        shutil.copyfile(os.path.join(source, name + ".stl"), os.path.join(staged, "meshes", name + ".stl"))
    # The source's window is inside out.
    window = os.path.join(staged, "meshes", "microwindow.stl")
    write_stl(window, [(a, c, b) for a, b, c in read_stl(window)])

    body = [box(mul(half, 2), xyz, name=name) for name, xyz, half in WALLS]
    across = (math.pi / 2, 0, 0)  # the MJCF writes 1.57
    handle = [
        capsule(0.02, 0.26, (0.475, -0.108, 0), name="handle"),
        capsule(0.02, 0.06, (0.475, -0.075, 0.13), across, name="handle_upper_post"),
        capsule(0.02, 0.06, (0.475, -0.075, -0.13), across, name="handle_lower_post"),
    ]
    panel = box((0.518, 0.048, 0.37), (0.259, -0.026, 0), name="door")
    offset = mul(HINGE, -1)  # the meshes are drawn in the body's frame
    parts = [
        link_element(
            "microwave",
            mass_properties([(s, WALL_MASS) for s in body]),
            [(mesh("meshes/micro.stl"), BLACK), (mesh("meshes/microbutton.stl"), METAL), (mesh("meshes/microfeet.stl"), METAL)],
            body,
        ),
        link_element(
            "door",
            mass_properties([(s, 0.02) for s in handle] + [(panel, 0.2)]),
            [(mesh("meshes/microdoor.stl", offset), BLACK), (mesh("meshes/microwindow.stl", offset), WINDOW)]
            + [(dict(s, name=None), METAL) for s in handle],
            handle + [panel],
        ),
        # The MJCF turns about +z from 0 to -2.094; here the axis is reversed, so that opening is positive.
        joint_element("door_hinge", "revolute", "microwave", "door", HINGE, axis=(0, 0, -1), limit=(0, 2.094, 10, 1000), dynamics=(2, 2)),
    ]
    with open(os.path.join(staged, "object.urdf"), "w") as f:
        f.write(robot_element("microwave", parts, "Made by world-models/convert from furniture_sim's microwave (Apache-2.0)"))
    with open(os.path.join(staged, "model.yaml"), "w") as f:
        f.write(DOCUMENT)


DOCUMENT = """\
schema: 1
name: microwave
description: A microwave oven whose door hangs on a vertical hinge at its left edge and has an upright bar handle.
category: microwave
movable: false
grasps:
  # The straight part between the posts, in the door's frame.
  - kind: bar
    name: handle
    link: door
    from: [0.475, -0.108, -0.1]
    to: [0.475, -0.108, 0.1]
    radius: 0.02
    outward: [0, -1, 0]
    swing: 1.2
    # From the bar's centre line to the door's face, which lies at y = -0.05.
    depth: 0.058
regions:
  # Between the inner faces of the collision boxes, and short of the shut door.
  - name: cavity
    link: microwave
    center: [-0.08, -0.0085, 0.192]
    size: [0.414, 0.335, 0.288]
    opening: [0, -1, 0]
surface_friction: 0.8
provenance:
  licence: Apache-2.0
  attribution: "furniture_sim, Copyright 2019 Vikash Kumar"
  origins:
    - source: https://github.com/vikashplus/furniture_sim, microwave/microwave_body0.xml
      version: c97995afb81c9e2d7325b0069f9abc9a2c74a2f0
  changes:
    - "MJCF written as URDF: collision geoms, masses, hinge, damping (2 N m s/rad) and dry friction (2 N m) are the source's, also the door's light 0.26 kg"
    - "The hinge's axis is reversed, so that the door opens in the positive direction"
    - "The handle's posts are turned by 90 degrees; the source rounds to 1.57 rad"
    - "The window's triangles are turned over; they face inwards in the source"
    - "The joint's armature of 0.01 kg m^2 is left out; textures are left out"
    - "The URDF's limits of speed and effort are our own, far from what the arm can do"
"""
