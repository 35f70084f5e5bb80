#!/usr/bin/env python3
"""Loads URDFs in MuJoCo and PyBullet, moves every joint through its range, and says what each engine makes of it.

    pip install mujoco pybullet
    python3 tests/peers/load_urdf.py FOLDER_OR_URDF...

Exits with 1 if an engine cannot load a file, sees other joints, or gets a number that is none.
"""

import math
import pathlib
import sys
import xml.etree.ElementTree


def wanted(path):
    """Names and limits of the joints that move."""
    joints = xml.etree.ElementTree.parse(path).getroot().findall("joint")
    limits = {}
    for joint in joints:
        if joint.get("type") in ("revolute", "prismatic"):
            limit = joint.find("limit")
            limits[joint.get("name")] = (float(limit.get("lower")), float(limit.get("upper")))
    return limits


def in_mujoco(path, limits):
    import mujoco

    # MuJoCo drops folders of meshes unless told otherwise.
    text = path.read_text()
    text = text.replace("<robot ", "<robot ", 1)
    head = text.index(">", text.index("<robot")) + 1
    option = '<mujoco><compiler strippath="false" meshdir="%s" balanceinertia="true"/></mujoco>' % path.parent.resolve()
    model = mujoco.MjModel.from_xml_string(text[:head] + option + text[head:])
    names = {mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, i) for i in range(model.njnt)}
    assert names == set(limits), f"joints {names}, not {set(limits)}"
    data = mujoco.MjData(model)
    for share in (0.0, 0.5, 1.0):
        for name, (low, high) in limits.items():
            data.joint(name).qpos[0] = low + share * (high - low)
        mujoco.mj_forward(model, data)
        assert all(math.isfinite(x) for x in data.qacc), "an acceleration is not a number"
    return f"{model.njnt} joints, {model.ngeom} shapes, {sum(model.body_mass):.2f} kg"


def in_pybullet(path, limits):
    import pybullet

    client = pybullet.connect(pybullet.DIRECT)
    try:
        body = pybullet.loadURDF(str(path), useFixedBase=True, physicsClientId=client)
        count = pybullet.getNumJoints(body, physicsClientId=client)
        infos = [pybullet.getJointInfo(body, i, physicsClientId=client) for i in range(count)]
        names = {info[1].decode() for info in infos if info[2] in (pybullet.JOINT_REVOLUTE, pybullet.JOINT_PRISMATIC)}
        assert names == set(limits), f"joints {names}, not {set(limits)}"
        for _ in range(100):
            pybullet.stepSimulation(physicsClientId=client)
        states = [pybullet.getJointState(body, i, physicsClientId=client)[0] for i in range(count)]
        assert all(math.isfinite(x) for x in states), "a position is not a number"
        return f"{count} joints"
    finally:
        pybullet.disconnect(client)


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    failed = False
    for name in sys.argv[1:]:
        path = pathlib.Path(name)
        path = path / "object.urdf" if path.is_dir() else path
        limits = wanted(path)
        for engine, load in (("mujoco", in_mujoco), ("pybullet", in_pybullet)):
            try:
                print(f"{path}: {engine}: {load(path, limits)}")
            except ImportError as missing:
                print(f"{path}: {engine}: not installed ({missing})")
            except Exception as error:  # whatever an engine throws is its answer
                failed = True
                print(f"{path}: {engine}: FAILED: {error}")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
