"""Times PyBullet: steps. It has no derivatives."""
import importlib.metadata

import pybullet as b
from peer_timing import DT, SCENE, model, row, start, version

version(f"PyBullet {importlib.metadata.version('pybullet')}")
for which, name in (("free", "free step"), ("contact", "gripping step, 8 contacts")):
    b.connect(b.DIRECT)
    b.setGravity(*SCENE["gravity"])
    b.setPhysicsEngineParameter(fixedTimeStep=DT, numSubSteps=1, deterministicOverlappingPairs=1)
    options = dict(useFixedBase=True, flags=b.URDF_USE_INERTIA_FROM_FILE)
    bodies = [b.loadURDF(model("panda"), **options)]
    if which == "contact":
        bodies.append(b.loadURDF(model("microwave"), SCENE["microwave_xyz"], **options))
    for body in bodies:
        for joint in range(-1, b.getNumJoints(body)):
            b.changeDynamics(body, joint, lateralFriction=SCENE["friction"], linearDamping=0, angularDamping=0)
            if joint >= 0 and b.getJointInfo(body, joint)[2] != b.JOINT_FIXED:
                # Joints have a motor that holds them still unless it is switched off.
                b.setJointMotorControl2(body, joint, b.VELOCITY_CONTROL, force=0)
    joints = [j for j in range(b.getNumJoints(bodies[0])) if b.getJointInfo(bodies[0], j)[2] != b.JOINT_FIXED]
    q, v, tau = start(which)

    def steps(count):
        for _ in range(count):
            b.setJointMotorControlArray(bodies[0], joints, b.TORQUE_CONTROL, forces=tau)
            b.stepSimulation()

    def settle():
        for joint, position, velocity in zip(joints, q, v):
            b.resetJointState(bodies[0], joint, position, velocity)
        for body in bodies[1:]:
            b.resetJointState(body, 0, 0, 0)
        steps(50 if which == "contact" else 0)

    row(name, 100, lambda: steps(100), settle)
    b.disconnect()
