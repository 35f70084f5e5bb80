"""Times MuJoCo: steps, and their derivatives by its own finite differences."""
import mujoco
import numpy as np
from peer_timing import DT, SCENE, model, row, start, version


def build(gripping):
    spec = mujoco.MjSpec.from_file(model("panda"))
    if gripping:
        frame = spec.worldbody.add_frame(pos=SCENE["microwave_xyz"])
        spec.attach(mujoco.MjSpec.from_file(model("microwave")), frame=frame, prefix="oven_")
    spec.option.timestep = DT
    # The faster ones of what it offers: explicit for free motion, elliptic cones for a grip.
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST if gripping else mujoco.mjtIntegrator.mjINT_EULER
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    for geom in spec.geoms:
        geom.friction[0], geom.condim = SCENE["friction"], 3
    for joint in [f"panda_joint{k}" for k in range(1, 8)] + ["panda_finger_joint1", "panda_finger_joint2"]:
        spec.add_actuator(name=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=joint).set_to_motor()
    m = spec.compile()
    return m, mujoco.MjData(m)


def put(m, d, which):
    mujoco.mj_resetData(m, d)
    d.qpos[:9], d.qvel[:9], d.ctrl[:9] = start(which)


version(f"MuJoCo {mujoco.__version__}")
for which, steps, step, derivatives, gradient in (
    ("free", 1000, "free step", "free step + A, B", "1,000 free steps + gradient"),
    ("contact", 300, "gripping step, 8 contacts", "gripping step + A, B", "300 gripping steps + gradient"),
):
    m, d = build(which == "contact")
    A, B = np.zeros((2 * m.nv, 2 * m.nv)), np.zeros((2 * m.nv, m.nu))
    put(m, d, which)
    mujoco.mj_step(m, d, 100 if which == "contact" else 0)
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    kept = np.zeros(mujoco.mj_stateSize(m, kind))
    mujoco.mj_getState(m, d, kept, kind)

    def settle():
        mujoco.mj_setState(m, d, kept, kind)

    row(step, 100, lambda: mujoco.mj_step(m, d, 100), settle)
    settle()
    mujoco.mj_forward(m, d)
    row(derivatives, 1, lambda: mujoco.mjd_transitionFD(m, d, 1e-6, False, A, B, None, None))

    if which == "contact":
        # Its least: the derivatives of each step by state and controls, which a gradient through contact chains.
        def chain():
            put(m, d, which)
            for _ in range(steps):
                mujoco.mjd_transitionFD(m, d, 1e-6, False, A, B, None, None)
                mujoco.mj_step(m, d)

        row(gradient, 1, chain)
    else:
        # One more rollout for each of 9 masses and 9 dampings.
        def differences():
            for _ in range(19):
                put(m, d, which)
                mujoco.mj_step(m, d, steps)

        row(gradient, 1, differences)
