#!/usr/bin/env python3
"""Writes some objects of furniture_sim and Meta-World as URDF, from their bodies in MJCF.

    python3 convert.py ASSETS OUT

ASSETS holds `furniture_sim/` and `metaworld/objects/assets/` as published. What can be seen is written: boxes, cylinders and capsules; where
an object's visible shapes are meshes, its shapes for collision stand for them. Masses are nobody's measurement: the objects are only looked at.
"""

import math
import pathlib
import sys
import xml.etree.ElementTree as ET

# name, source, which class of geoms is left out, origin above the ground, m
OBJECTS = [
    ("slide_cabinet", "furniture_sim/slidecabinet/slidecabinet_body.xml", "collision", 0.2),
    ("hinge_cabinet", "furniture_sim/hingecabinet/hingecabinet_body.xml", "collision", 0.2),
    ("box_cabinet", "furniture_sim/boxcabinet/boxcabinet_body.xml", "collision", 0.2),
    ("window", "metaworld/objects/assets/window.xml", "meshes", 0.0),
    ("laptop", "metaworld/objects/assets/laptop.xml", "meshes", 0.0),
]


def numbers(text, count):
    return [float(x) for x in (text or " ".join(["0"] * count)).split()]


def geom(element, skip):
    kind, of = element.get("type"), element.get("class") or ""
    if kind not in ("box", "cylinder", "capsule"):
        return None
    if skip == "collision" and "collision" in of or skip == "meshes" and "col" not in of:
        return None
    size = numbers(element.get("size"), 3)
    shape = {
        "box": lambda: f'<box size="{2 * size[0]:g} {2 * size[1]:g} {2 * size[2]:g}"/>',
        "cylinder": lambda: f'<cylinder radius="{size[0]:g}" length="{2 * size[1]:g}"/>',
        # URDF has no capsule.
        "capsule": lambda: f'<cylinder radius="{size[0]:g}" length="{2 * (size[1] + size[0]):g}"/>',
    }[kind]()
    # One angle at a time is used in these files, so the order of angles does not matter; 1.57 stands for a right angle.
    euler = [round(a / (math.pi / 2), 2) * math.pi / 2 for a in numbers(element.get("euler"), 3)]
    pos = numbers(element.get("pos"), 3)
    return pos, euler, shape


def three(values):
    return " ".join(f"{v:.9g}" for v in values)


def convert(name, source, skip, height):
    body = ET.parse(source).getroot().find("body")
    out = ['<?xml version="1.0"?>', f'<robot name="{name}">']

    def link(element, number, shift):
        label = "body" if number == 0 else f"part_{number}"
        out.append(f'  <link name="{label}">')
        out.append('    <inertial><mass value="1"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>')
        for pos, euler, shape in filter(None, (geom(g, skip) for g in element.findall("geom"))):
            pos = [p + s for p, s in zip(pos, shift)]
            origin = f'<origin xyz="{three(pos)}" rpy="{three(euler)}"/>'
            out.append(f"    <visual>{origin}<geometry>{shape}</geometry></visual>")
        out.append("  </link>")

    link(body, 0, [0, 0, height])
    for number, child in enumerate(body.findall("body"), 1):
        link(child, number, [0, 0, 0])
        joint = child.find("joint")
        kind = "prismatic" if joint.get("type") == "slide" else "revolute"
        low, high = numbers(joint.get("range"), 2)
        axis = numbers(joint.get("axis"), 3)
        pos = numbers(child.get("pos"), 3)
        pos[2] += height
        out.append(f'  <joint name="joint_{number}" type="{kind}"><parent link="body"/><child link="part_{number}"/>')
        out.append(f'    <origin xyz="{three(pos)}"/><axis xyz="{three(axis)}"/>')
        out.append(f'    <limit lower="{low:g}" upper="{high:g}" effort="10" velocity="2"/></joint>')
    return "\n".join(out + ["</robot>", ""])


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    assets, target = map(pathlib.Path, sys.argv[1:])
    for name, source, skip, height in OBJECTS:
        (target / name).mkdir(parents=True, exist_ok=True)
        (target / name / "object.urdf").write_text(convert(name, assets / source, skip, height))


if __name__ == "__main__":
    main()
