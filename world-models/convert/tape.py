"""A roll of tape, our own solid: a ring of 80 mm outside and 56 mm inside, 85 mm wide, 0.2 kg: a broad roll.

Physics sees sixteen boxes around the ring. A box's inner face touches the inner circle at its middle and its outer
face runs through the outer circle at its corners, so that no box sticks out of the ring.
"""

import os

from common import *

OUTER, INNER, WIDTH, MASS, BOXES = 0.040, 0.028, 0.085, 0.2, 16
BROWN = (0.72, 0.55, 0.32, 1)


def ring_mesh(outer, inner, width, segments):
    """A closed ring standing on z = 0."""
    triangles = []
    at = lambda r, i, z: (r * math.cos(2 * math.pi * i / segments), r * math.sin(2 * math.pi * i / segments), z)
    for i in range(segments):
        j = (i + 1) % segments
        for a, b, c, d in (
            (at(outer, i, 0), at(outer, j, 0), at(outer, j, width), at(outer, i, width)),
            (at(inner, j, 0), at(inner, i, 0), at(inner, i, width), at(inner, j, width)),
            (at(inner, i, width), at(outer, i, width), at(outer, j, width), at(inner, j, width)),
            (at(outer, i, 0), at(inner, i, 0), at(inner, j, 0), at(outer, j, 0)),
        ):
            triangles += [(a, b, c), (a, c, d)]
    return triangles


def ring_boxes(outer, inner, z, height, count, name):
    """Boxes around a ring; each fills its sector from the inner circle to the outer circle's chord."""
    half = math.pi / count
    chord = outer * math.cos(half)
    boxes = []
    for i in range(count):
        a = 2 * half * i
        r = (inner + chord) / 2
        boxes.append(box((chord - inner, 2 * outer * math.sin(half), height), (r * math.cos(a), r * math.sin(a), z), (0, 0, a), f"{name}_{i}"))
    return boxes


def convert(assets, staged):
    os.makedirs(os.path.join(staged, "meshes"))
    # The mesh is inscribed in the same polygon as the boxes: what is seen is what touches.
    write_stl(os.path.join(staged, "meshes", "tape.stl"), transform(ring_mesh(OUTER, INNER / math.cos(math.pi / BOXES), WIDTH, BOXES), rotation_of((0, 0, math.pi / BOXES))))
    ro2, ri2 = OUTER**2, INNER**2
    across = MASS * (3 * (ro2 + ri2) + WIDTH**2) / 12
    I = ((across, 0, 0), (0, across, 0), (0, 0, MASS * (ro2 + ri2) / 2))
    parts = [
        link_element(
            "tape",
            (MASS, (0, 0, WIDTH / 2), I),
            [(mesh("meshes/tape.stl"), BROWN)],
            ring_boxes(OUTER, INNER, WIDTH / 2, WIDTH, BOXES, "wall"),
        )
    ]
    with open(os.path.join(staged, "object.urdf"), "w") as f:
        f.write(robot_element("tape", parts, "Made by world-models/convert"))
    with open(os.path.join(staged, "model.yaml"), "w") as f:
        f.write(DOCUMENT)


DOCUMENT = """\
schema: 1
name: tape
description: A broad roll of tape, 80 mm outside, 56 mm inside and 85 mm wide, lying flat.
category: tape
movable: true
grasps:
  - kind: rim
    name: wall
    link: tape
    center: [0, 0, 0.085]
    axis: [0, 0, 1]
    radius: 0.034
    thickness: 0.012
    depth: 0.02
    tilt: 0.5
surface_friction: 0.8
provenance:
  licence: Apache-2.0
  attribution: "The authors of this project"
  origins:
    - source: "drawn here, in world-models/convert/tape.py"
"""
