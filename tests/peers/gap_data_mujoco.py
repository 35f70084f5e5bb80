"""Makes recordings with effects that their models lack, by MuJoCo, and the sealed truth of each.

    python gap_data_mujoco.py [--seed 7] [--out tests/measured/mujoco]

One folder a mechanism: object.urdf and model.yaml (what is known), train_*.csv and held_out_*.csv. The truth lies apart, in sealed/.
MuJoCo's own damping, frictionloss, armature, springs and tendons make the effects where it has them; the others act through
qfrc_applied. Masses are off by up to 1.5 % from what the URDF says.
"""
import argparse
import json
import pathlib

import mujoco
import numpy as np

RATE, STEP = 200, 5e-4
DOOR = {"name": "door", "axis": (0, 0, -1), "com": (0.26, -0.03, 0.0), "mass": 2.4, "size": (0.5, 0.05, 0.4), "range": (0.0, 1.6), "drive": "hand"}
ROD = {"name": "pendulum", "axis": (0, 1, 0), "com": (0.0, 0.0, -0.22), "mass": 0.9, "size": (0.03, 0.03, 0.4), "range": (-1.8, 1.8), "drive": "torque"}


def inertia(mass, size):
    x, y, z = (s * s for s in size)
    return tuple(mass / 12 * s for s in (y + z, x + z, x + y))


def about_axis(part):
    """Inertia about the joint's axis, and the weight's lever times the weight."""
    com, axis = np.array(part["com"], float), np.abs(np.array(part["axis"], float))
    i = float(np.dot(inertia(part["mass"], part["size"]), axis))
    return i + part["mass"] * float(com @ com - (com @ axis) ** 2)


def urdf(part, damping, friction):
    (x, y, z), (ix, iy, iz) = part["com"], inertia(part["mass"], part["size"])
    lower, upper = part["range"][0] - 0.4, part["range"][1] + 0.4
    return f"""<?xml version="1.0"?>
<robot name="{part['name']}">
  <link name="base"/>
  <link name="part">
    <inertial><origin xyz="{x} {y} {z}"/><mass value="{part['mass']}"/>
      <inertia ixx="{ix:.9f}" iyy="{iy:.9f}" izz="{iz:.9f}" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="hinge" type="revolute">
    <parent link="base"/><child link="part"/><origin xyz="0 0 1"/><axis xyz="{' '.join(map(str, part['axis']))}"/>
    <limit lower="{lower}" upper="{upper}" velocity="20" effort="100"/><dynamics damping="{damping}" friction="{friction}"/>
  </joint>
</robot>
"""


def model(part, factor, damping, friction, effect):
    """The true mechanism as MuJoCo has it."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.timestep, spec.option.integrator = STEP, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.iterations, spec.option.tolerance = 100, 1e-12
    name, p = (effect["effect"], effect["parameters"]) if effect else (None, {})
    body = spec.worldbody.add_body(name="part", pos=[0, 0, 1], ipos=list(part["com"]), explicitinertial=True)
    body.mass = part["mass"] * factor
    body.inertia = [factor * i for i in inertia(part["mass"], part["size"])]
    joint = body.add_joint(name="hinge", type=mujoco.mjtJoint.mjJNT_HINGE, axis=list(part["axis"]))
    # Springs and dampers are polynomials since MuJoCo 4: these are linear.
    linear = lambda x: [x, 0, 0]
    joint.damping = linear(damping + p.get("damping", 0.0) * (name == "viscous_friction"))
    joint.frictionloss = friction + p.get("friction", 0.0) * (name == "coulomb_friction")
    # Dry friction as hard as it can be made.
    joint.solref_friction, joint.solimp_friction = [2 * STEP, 1], [0.999, 0.9999, 0.001, 0.5, 2]
    joint.armature = p.get("inertia", 0.0) * (name == "armature_inertia")
    if name == "joint_spring":
        joint.stiffness = linear(p["stiffness"])
        joint.springref = p["rest_position"]
    if name == "joint_elasticity":
        # The rotor: a wheel of its own on the same axis, coupled by a spring along the tendon `rotor - link`.
        rotor = spec.worldbody.add_body(name="rotor", pos=[0, 0, 1], explicitinertial=True)
        rotor.mass, rotor.ipos, rotor.inertia = 0.1, [0, 0, 0], [p["rotor_inertia"]] * 3
        rotor.add_joint(name="rotor", type=mujoco.mjtJoint.mjJNT_HINGE, axis=list(part["axis"]))
        tendon = spec.add_tendon(name="shaft", springlength=[0, 0])
        tendon.stiffness, tendon.damping = linear(p["stiffness"]), linear(p["damping"])
        tendon.wrap_joint("rotor", 1.0)
        tendon.wrap_joint("hinge", -1.0)
    return spec.compile()


def reference(family, t, part, phases):
    low, high = part["range"]
    center, size = (low + high) / 2, (high - low)
    if family == "ramp":
        x = (t / 7.6) % 1.0
        return low + 0.02 * size + 0.94 * size * (1 - np.cos(2 * np.pi * x)) / 2
    if family == "sines":
        f = (0.23, 0.61, 1.37)
        return center + 0.42 * size * sum(np.sin(2 * np.pi * f * t + p) / (1 + k) for k, (f, p) in enumerate(zip(f, phases))) / 1.84
    if family == "chirp":
        f0, f1, long = 0.25, 5.0, 8.0
        g = (f1 / f0) ** (t / long)
        return center + 0.42 * size * g**-1.3 * np.sin(2 * np.pi * f0 * long / np.log(f1 / f0) * (g - 1))
    steps = np.array([0.35, -0.25, 0.1, -0.4, 0.2, 0.42, -0.1, 0.3])
    k = int(t / 0.9) % len(steps)
    x = np.clip((t / 0.9 - int(t / 0.9)) * 0.9 / 0.12, 0, 1)
    return center + size * (steps[k - 1] + (steps[k] - steps[k - 1]) * (3 * x * x - 2 * x**3))


def trajectory(part, m, effect, family, seconds, noise, rng):
    d = mujoco.MjData(m)
    name, p = (effect["effect"], effect["parameters"]) if effect else (None, {})
    phases, J = rng.uniform(0, 2 * np.pi, 3), about_axis(part)
    weight = part["mass"] * 9.81 * abs(part["com"][2]) if part["drive"] == "torque" else 0.0
    motor = 1 if name == "joint_elasticity" else 0
    d.qpos[:] = reference(family, 0.0, part, phases)
    follow, rows, e = (4.0 if motor else 11.0), [], 1e-3
    hold = round(1 / RATE / STEP)
    for k in range(int(seconds * RATE)):
        t, q, v = k / RATE, d.qpos[0], d.qvel[0]
        r = [reference(family, max(t + s, 0), part, phases) for s in (-e, 0, e)]
        a = np.clip((r[0] - 2 * r[1] + r[2]) / e**2, -80, 80)
        u = weight * np.sin(q) + J * (follow**2 * (r[1] - q) + 1.6 * follow * ((r[2] - r[0]) / (2 * e) - v) + a)
        rows.append((t, q, u))
        for _ in range(hold):
            d.qfrc_applied[:] = 0
            d.qfrc_applied[motor] += u
            if name == "quadratic_drag":
                d.qfrc_applied[0] -= p["drag"] * d.qvel[0] * abs(d.qvel[0])
            if name == "torque_ripple":
                d.qfrc_applied[0] -= p["amplitude"] * np.sin(p["cycles_per_turn"] * d.qpos[0] + p["phase"])
            mujoco.mj_step(m, d)
    rows = np.array(rows)
    rows[:, 1] += noise[0] * rng.standard_normal(len(rows))
    if part["drive"] == "hand":
        rows[:, 2] += noise[1] * np.ptp(rows[:, 2]) * rng.standard_normal(len(rows))
    return rows


def effects(rng):
    """What is hidden: part, known damping and friction, effect."""
    near = lambda x: round(float(x * rng.uniform(0.7, 1.4)), 5)
    phase = round(float(rng.uniform(-3, 3)), 4)
    spring = {"stiffness": near(1.5), "rest_position": round(float(rng.uniform(-0.2, 0.3)), 4)}
    ripple = {"amplitude": near(0.12), "cycles_per_turn": float(rng.integers(8, 20)), "phase": phase}
    Jp = about_axis(ROD)
    elastic = {"stiffness": near(Jp * (2 * np.pi * 6) ** 2), "damping": near(0.2), "rotor_inertia": near(0.25 * Jp)}
    return {
        "clean": (ROD, 0.02, 0.0, None, None),
        "a": (DOOR, 0.0, 0.3, "viscous_friction", {"damping": near(0.4)}),
        "b": (DOOR, 0.1, 0.0, "coulomb_friction", {"friction": near(0.4)}),
        "c": (DOOR, 0.1, 0.2, "joint_spring", spring),
        "d": (ROD, 0.02, 0.0, "armature_inertia", {"inertia": near(0.3 * Jp)}),
        "e": (ROD, 0.02, 0.0, "torque_ripple", ripple),
        "f": (ROD, 0.0, 0.05, "quadratic_drag", {"drag": near(0.03)}),
        "g": (ROD, 0.02, 0.0, "joint_elasticity", elastic),
    }


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--seed", type=int, default=7)
    arguments.add_argument("--out", type=pathlib.Path, default=pathlib.Path(__file__).parents[1] / "measured" / "mujoco")
    given = arguments.parse_args()
    rng = np.random.default_rng(given.seed)
    (given.out / "sealed").mkdir(parents=True, exist_ok=True)
    for folder, (part, damping, friction, name, parameters) in effects(rng).items():
        effect = name and {"effect": name, "joint": "hinge", "parameters": parameters}
        factor, noise = float(rng.uniform(0.985, 1.015)), (float(rng.choice([2e-5, 2e-4])), float(rng.choice([0.001, 0.005])))
        true = [damping * float(rng.uniform(0.9, 1.1)), friction * float(rng.uniform(0.9, 1.1))]
        m = model(part, factor, *true, effect)
        out = given.out / folder
        out.mkdir(exist_ok=True)
        (out / "object.urdf").write_text(urdf(part, damping, friction))
        actuator = "actuators:\n  - {joint: hinge, law: {kind: torque}}\n" if part["drive"] == "torque" else ""
        (out / "model.yaml").write_text(f"schema: 1\nname: {part['name']}\n{actuator}")
        column = "hinge.command_effort" if part["drive"] == "torque" else "hinge.effort"
        for file, family in (("train_1", "ramp"), ("train_2", "sines"), ("train_3", "chirp"), ("held_out_1", "steps")):
            rows = trajectory(part, m, effect, family, 5.0 if family != "steps" else 4.0, noise, rng)
            lines = [f"{t:.3f},{q:.6f},{u:.9g}" if part["drive"] == "torque" else f"{t:.3f},{q:.6f},{u:.5f}" for t, q, u in rows]
            (out / f"{file}.csv").write_text("\n".join([f"time,hinge.position,{column}"] + lines) + "\n")
        truth = {
            "seed": given.seed, "engine": f"MuJoCo {mujoco.__version__}, implicitfast, {STEP} s", "hidden": [effect] if effect else [],
            "mass_factor": round(factor, 6), "damping": round(true[0], 6), "friction": round(true[1], 6), "noise": noise,
        }
        (given.out / "sealed" / f"{folder}.json").write_text(json.dumps(truth, indent=1) + "\n")


main()
