"""Recordings of one joint in which effects are hidden, by a small engine of its own, and how `sagci gap` answers to them.

    python3 tests/peers/one_joint.py OUT [--first 0] [--count 34] [--seed 1] [--effects 1] [--limits] [--outside] [--sagci target/release/sagci]

Needs nothing but Python. The engine takes steps of 0.1 ms by the semi-implicit Euler rule, and dry friction is the impulse that may
stop the joint (neither is done so by our simulator or by the engines of `sagci evaluate gap`). It covers what recordings differ by:
hand, torque, position servo and motor by voltage; 60 to 1000 Hz; uneven times, lost rows, encoders that read in steps, commands on a
slower clock, noisy velocities. With --limits a joint reaches a limit of its URDF, which gives way as MuJoCo's do by default
(solref .02 1, solimp .9 .95 .001). With --effects 2 or 3 so many are there at once, of which no two make much the same force.
With --outside what is hidden is none of the catalogue's, and "unknown" is the right answer to it.

OUT/NAME/ holds object.urdf, model.yaml, train_*.csv and held_out.csv; OUT/sealed/NAME.json the truth, in the names and parameters of the
catalogue. With --sagci each is asked for, answers go to OUT/answers/, and a line says which is right.
"""
import argparse
import bisect
import json
import math
import pathlib
import random
import subprocess

STEP = 1e-4
JOINT = "joint_a"
DURATION = {60: 16, 100: 14, 200: 10, 500: 8, 1000: 5}
DRIVES = {
    "pendulum": ["command_effort", "command_position", "command_voltage", "effort"],
    "slide": ["command_effort", "effort", "command_position"],
    "door": ["effort", "command_effort"],
}
AXIS = {"pendulum": "0 1 0", "door": "0 0 1", "slide": "1 0 0"}
RECORDED = ["evenly", "unevenly", "with lost rows", "in encoder steps", "with slow commands", "with noisy velocities"]
# What acts on the command shows under a command alone.
OF_DRIVES = {
    "torque_gain", "transport_delay", "actuator_lag", "actuator_saturation", "armature_inertia", "torque_ripple", "clock_skew", "backlash",
    "joint_elasticity",
}
OF_WEIGHT = {"payload", "encoder_offset", "hinge_tilt", "load_dependent_friction"}
SHUTS = {"magnetic_gasket", "soft_close_damper"}
# Friction or damping that the model states is refitted, so that more of it is none that is missing.
OWN_FRICTION = {"coulomb_friction", "asymmetric_friction", "stribeck_friction", "presliding_hysteresis"}
# At most one of each is there at once: together they could not be told apart, or the engine has room for one.
AT_MOST_ONE = [
    OWN_FRICTION | {"thermal_wear"},
    {"viscous_friction", "asymmetric_friction", "thermal_wear"},
    {"transport_delay", "clock_skew", "actuator_lag"},
    {"backlash", "joint_elasticity"},
    {"payload", "armature_inertia", "torque_gain"},
    {"hinge_tilt", "torque_bias", "encoder_offset", "sensor_drift", "payload", "joint_spring", "cable_hysteresis"},
    {"asymmetric_friction", "torque_bias"},
    {"magnetic_gasket", "soft_close_damper"},
]


def sign(x):
    return (x > 0) - (x < 0)


def draw(r, s):
    """Parameters by effect; `s` are typical sizes: effort, speed, reach, inertia, mass, weight's lever."""
    u, either = r.uniform, lambda: r.choice([-1, 1])
    f, v, a, m = s["effort"], s["speed"], s["reach"], s["inertia"]
    rotor, hertz, level = m * u(0.1, 0.4), 2 * math.pi * u(5, 15), f * u(0.06, 0.2)
    return {
        "clean": {},
        "viscous_friction": {"damping": f * u(0.05, 0.3) / v},
        "coulomb_friction": {"friction": f * u(0.05, 0.25)},
        "asymmetric_friction": {"friction_positive": f * u(0.05, 0.1), "friction_negative": f * u(0.12, 0.25),
                                "damping_positive": f * u(0.05, 0.1) / v, "damping_negative": f * u(0.15, 0.3) / v},
        "stribeck_friction": {"friction": 0.5 * level, "static_friction": level * u(0.75, 1.25), "stribeck_velocity": v * u(0.05, 0.15), "exponent": 2.0},
        "quadratic_drag": {"drag": f * u(0.1, 0.4) / v**2},
        "presliding_hysteresis": {"stiffness": level / (a * u(0.001, 0.006)), "micro_damping": 0.0, "friction": level,
                                  "static_friction": level * u(1, 1.6), "stribeck_velocity": v * u(0.02, 0.1)},
        "load_dependent_friction": {"load_coefficient": u(0.06, 0.25)},
        "position_dependent_friction": {"friction": f * u(0.02, 0.06), "amplitude": f * u(0.08, 0.2), "position": a * u(-0.2, 0.2), "width": a * u(0.05, 0.15)},
        "joint_spring": {"stiffness": f * u(0.2, 0.6) / a, "rest_position": a * u(-0.3, 0.3)},
        "hinge_tilt": {"amplitude": s["weight"] * u(0.05, 0.2), "phase": u(-3, 3)},
        "cable_hysteresis": {"stiffness": f * u(0.1, 0.3) / a, "rest_position": a * u(-0.3, 0.3), "loop_force": f * u(0.06, 0.15),
                             "loop_length": a * u(0.05, 0.2), "damping": f * u(0.01, 0.05) / v},
        "torque_bias": {"bias": f * u(0.05, 0.2) * either()},
        "magnetic_gasket": {"force": f * u(0.5, 1.2), "width": a * u(0.03, 0.1)},
        "detent": {"force": f * u(0.2, 0.5), "position": a * u(-0.2, 0.2), "width": a * u(0.03, 0.08)},
        "soft_close_damper": {"damping": f * u(0.3, 1) / v, "position": a * u(0.3, 0.5), "stiffness": f * u(0.2, 0.5) / a},
        "hard_stop": {"stiffness": m * u(2e3, 8e3), "dissipation": m * u(1e3, 6e3), "position": a * u(0.25, 0.5), "side": 1.0},
        "backlash": {"half_gap": a * u(0.005, 0.03), "rotor_inertia": m * u(0.05, 0.3)},
        "joint_elasticity": {"stiffness": rotor * hertz**2, "damping": 0.1 * rotor * hertz, "rotor_inertia": rotor},
        "torque_ripple": {"amplitude": f * u(0.05, 0.15), "cycles_per_turn": r.choice([9, 12, 18, 24]) / a, "phase": u(0, 6)},
        "transport_delay": {"delay": u(0.008, 0.03)},
        "actuator_lag": {"time_constant": u(0.01, 0.05)},
        "armature_inertia": {"inertia": m * u(0.1, 0.5)},
        "torque_gain": {"gain_error": u(0.08, 0.3) * either()},
        "actuator_saturation": {"limit": f * u(0.6, 1.0)},
        "payload": {"mass": s["mass"] * u(0.1, 0.4), "x": u(-0.1, 0.1), "y": 0.0, "z": -u(0.1, 0.4)},
        "encoder_offset": {"offset": u(0.03, 0.12) * either(), "scale_error": 0.0},
        "sensor_drift": {"bias": a * u(0.01, 0.05), "rate": a * u(-0.002, 0.002)},
        "clock_skew": {"skew": u(0.006, 0.025) * either()},
        "thermal_wear": {"amplitude": u(0.5, 1.2), "time_constant": u(8, 25)},
    }


def draw_outside(r, s):
    """Parameters of what no catalogue has, by name."""
    u = r.uniform
    f, v, a, m = s["effort"], s["speed"], s["reach"], s["inertia"]
    return {
        # One way only, as a rubber band.
        "band": {"stiffness": f * u(0.4, 1.0) / a, "position": a * u(-0.2, 0.2)},
        # A force that grows with the square of the way, as a leaf that is wound up.
        "hardening": {"stiffness": f * u(0.3, 0.9) / a**3},
        # Dry friction that grows from one end to the other.
        "wedge": {"friction": f * u(0.08, 0.2), "grows": u(0.5, 0.9) * r.choice([-1, 1])},
        # A wheel out of balance that somebody else drives.
        "shaker": {"amplitude": f * u(0.06, 0.2), "pace": 2 * math.pi * u(1.5, 6), "phase": u(0, 6)},
        # The body becomes lighter half-way through each recording.
        "spill": {"share": u(0.15, 0.4)},
        # Small commands do nothing.
        "dead_band": {"width": f * u(0.05, 0.2)},
        # The drive's effort changes no faster than so.
        "slew": {"rate": f * u(3, 12)},
        # Friction that is less the longer the joint has been moving.
        "warms_up": {"friction": f * u(0.1, 0.25), "time": u(0.3, 1.5)},
        # Damping where oil is, to both sides of a place.
        "oil": {"damping": f * u(0.3, 0.9) / v, "position": a * u(-0.2, 0.2), "width": a * u(0.1, 0.3)},
        # Steps that a ratchet makes one way only.
        "ratchet": {"friction": f * u(0.1, 0.3), "pitch": a * u(0.15, 0.4)},
        # One of so many commands arrives.
        "lost_commands": {"each": r.choice([2, 3, 4])},
        # A current that flows with the joint's angle and its velocity.
        "eddy": {"damping": f * u(0.15, 0.5) / v, "cycles": r.choice([2, 3, 4]) / a},
    }


def names_of(draws):
    return sorted(draws(random.Random(0), dict.fromkeys(["effort", "speed", "reach", "inertia", "mass", "weight"], 1.0)))


OUTSIDE = names_of(draw_outside)
EFFECTS = names_of(draw)


class Joint:
    """A joint with its effects: what acts on it beside the drive, and its state."""

    def __init__(self, effects, known, true, give_way, reach=1.0):
        self.effects, self.known, self.true, self.give_way, self.reach = effects, known, true, give_way, reach
        self.session, self.lasts = 0.0, math.inf

    def start(self, q):
        self.q, self.v, self.rotor, self.rotor_speed, self.lagged = q, 0.0, q, 0.0, 0.0
        self.z = dict.fromkeys(self.effects, 0.0)

    def drive(self, tau):
        """What comes through of an effort that is asked for: it is misread, lags, is cut off, and goes through a gear, in this order."""
        if p := self.effects.get("dead_band"):
            tau = sign(tau) * max(0.0, abs(tau) - p["width"])
        if p := self.effects.get("slew"):
            self.lagged += max(-STEP * p["rate"], min(STEP * p["rate"], tau - self.lagged))
            tau = self.lagged
        if p := self.effects.get("torque_gain"):
            tau = (1 - p["gain_error"]) * tau
        if p := self.effects.get("actuator_lag"):
            self.lagged += STEP / p["time_constant"] * (tau - self.lagged)
            tau = self.lagged
        if p := self.effects.get("actuator_saturation"):
            tau = max(-p["limit"], min(p["limit"], tau))
        apart, closing = self.rotor - self.q, self.rotor_speed - self.v
        if p := self.effects.get("backlash"):
            deep = max(0.0, abs(apart) - p["half_gap"]) * sign(apart)
            mesh = p["rotor_inertia"] * (1.2e3**2 * deep + 300.0 * closing) if deep else 0.0
            return self.through(p, tau, mesh if mesh * deep > 0 else 0.0)
        if p := self.effects.get("joint_elasticity"):
            return self.through(p, tau, p["stiffness"] * apart + p["damping"] * closing)
        return tau

    def through(self, p, tau, mesh):
        """What a gear passes on while its rotor turns."""
        self.rotor_speed += STEP * (tau - mesh) / p["rotor_inertia"]
        self.rotor += STEP * self.rotor_speed
        return mesh

    def resists(self, t):
        """What resists the motion beside what the model has, but for dry friction."""
        return sum(self.lacking(n, p, t) for n, p in self.effects.items())

    def lacking(self, n, p, t):
        """The same of one effect."""
        q, v = self.q, self.v
        if n == "viscous_friction":
            return p["damping"] * v
        if n == "asymmetric_friction":
            return p["damping_positive" if v > 0 else "damping_negative"] * v
        if n == "quadratic_drag":
            return p["drag"] * v * abs(v)
        if n == "joint_spring":
            return p["stiffness"] * (q - p["rest_position"])
        if n == "hinge_tilt":
            return p["amplitude"] * math.sin(q + p["phase"])
        if n == "torque_bias":
            return p["bias"]
        if n == "torque_ripple":
            return p["amplitude"] * math.sin(p["cycles_per_turn"] * q + p["phase"])
        if n == "detent":
            x = (q - p["position"]) / p["width"]
            return p["force"] * x * math.exp(0.5 - 0.5 * x * x)
        if n == "magnetic_gasket":
            return p["force"] * math.exp(-max(q, 0.0) / p["width"])
        if n == "soft_close_damper":
            return p["stiffness"] * q + (p["damping"] * v if v < 0 else 0.0) if q < p["position"] else 0.0
        if n == "hard_stop":
            deep = q - p["position"]
            return max(0.0, deep * (p["stiffness"] + p["dissipation"] * v)) if deep > 0 else 0.0
        if n == "cable_hysteresis":
            self.z[n] += STEP * abs(v) * (sign(v) - self.z[n]) / p["loop_length"]
            return p["stiffness"] * (q - p["rest_position"]) + p["loop_force"] * self.z[n] + p["damping"] * v
        if n == "presliding_hysteresis":
            g = p["friction"] + (p["static_friction"] - p["friction"]) * math.exp(-((v / p["stribeck_velocity"]) ** 2))
            self.z[n] = (self.z[n] + STEP * v) / (1 + STEP * p["stiffness"] * abs(v) / g)
            return p["stiffness"] * self.z[n]
        if n == "band":
            return p["stiffness"] * max(0.0, q - p["position"])
        if n == "hardening":
            return p["stiffness"] * q**3
        if n == "shaker":
            return p["amplitude"] * math.sin(p["pace"] * t + p["phase"])
        if n == "oil":
            return p["damping"] * v * math.exp(-(((q - p["position"]) / p["width"]) ** 4))
        if n == "eddy":
            return p["damping"] * v * math.sin(p["cycles"] * q) ** 2
        if n == "thermal_wear":
            return self.true["damping"] * v * p["amplitude"] * math.exp(-t / p["time_constant"])
        return 0.0

    def dry(self, t, tau, weight, way):
        """Level of dry friction."""
        level = self.true["friction"]
        for n, p in self.effects.items():
            if n == "coulomb_friction":
                level += p["friction"]
            if n == "asymmetric_friction":
                level += p["friction_positive" if way > 0 else "friction_negative"]
            if n == "stribeck_friction":
                level += p["friction"] + (p["static_friction"] - p["friction"]) * math.exp(-(abs(self.v / p["stribeck_velocity"]) ** p["exponent"]))
            if n == "position_dependent_friction":
                level += p["friction"] + p["amplitude"] * math.exp(-(((self.q - p["position"]) / p["width"]) ** 2) / 2)
            if n == "wedge":
                level += p["friction"] * (1 + p["grows"] * max(-1.0, min(1.0, self.q / self.reach)))
            if n == "warms_up":
                self.z[n] = max(0.0, self.z[n] + STEP * (1.0 if abs(self.v) > 0.02 * self.reach else -5.0))
                level += p["friction"] * math.exp(-self.z[n] / p["time"])
            if n == "ratchet" and way < 0:
                level += p["friction"] * (self.q / p["pitch"] % 1.0)
            if n == "load_dependent_friction":
                level += p["load_coefficient"] * abs(tau + weight)
            if n == "thermal_wear":
                level += self.true["friction"] * p["amplitude"] * math.exp(-t / p["time_constant"])
        return level

    def step(self, t, tau):
        spilt = self.effects.get("spill", {}).get("share", 0.0) if t - self.session > 0.5 * self.lasts else 0.0
        tau, inertia = self.drive(tau), self.true["inertia"] * (1 - spilt)
        weight = (self.true["sine"] * math.sin(self.q) - self.true["cosine"] * math.cos(self.q)) * (1 - spilt)
        force = tau - weight - self.true["damping"] * self.v - self.resists(t)
        if self.give_way and self.q < 0:
            free, share = force / inertia, 0.9 + 0.05 * min(1.0, -self.q / 1e-3)
            held = (1 - share) * free - share * (2 * self.v / (0.95 * 0.02) + self.q / (0.95 * 0.02) ** 2)
            force = inertia * max(free, held)
        speed = self.v + STEP * force / inertia
        self.v = speed - sign(speed) * min(abs(speed), STEP * self.dry(t, tau, weight, speed) / inertia)
        self.q += STEP * self.v


def way_of(r, kind, duration):
    """Where the joint is to go, by time, within one to both sides."""
    hertz, phase = [r.uniform(0.2, 0.5), r.uniform(0.5, 1.2), r.uniform(1.2, 2.5)], [r.uniform(0, 6) for _ in range(3)]
    levels, hold = [r.uniform(-1, 1) for _ in range(200)], r.uniform(0.4, 1.0)
    turn = 2 * math.pi
    return {
        "sines": lambda t: sum(a * math.sin(turn * w * t + b) for a, w, b in zip((0.6, 0.35, 0.12), hertz, phase)),
        "steps": lambda t: levels[int(t / hold)],
        "chirp": lambda t: 0.8 * math.sin(turn * (0.2 * t + t * t / duration)),
        "mixed": lambda t: 0.5 * levels[int(t / (2 * hold))] + 0.5 * math.sin(turn * hertz[0] * t + phase[0]),
    }[kind]


def drawn(k, seed, count, outside=False):
    """The effects of a recording: the first in turns, others that go with it by chance."""
    if outside:
        return [OUTSIDE[k % len(OUTSIDE)]]
    chosen, r = {EFFECTS[k % len(EFFECTS)]}, random.Random(1000003 * seed + k)
    while len(chosen) < count and "clean" not in chosen:
        another = r.choice(EFFECTS)
        together = chosen | {another}
        # A door that shuts hangs upright, and of weight is what hangs.
        apart = together & SHUTS and together & OF_WEIGHT
        if another not in chosen | {"clean"} and not apart and all(len(together & group) < 2 for group in AT_MOST_ONE):
            chosen = together
    return sorted(chosen)


def named(k, effects):
    return f"{k:03}_" + "+".join(effects)


def make(out, k, seed, count, limits, outside):
    r = random.Random(1000 * seed + k)
    chosen = drawn(k, seed, count, outside)
    there = set(chosen)
    mechanism = "pendulum" if there & OF_WEIGHT else r.choice(list(DRIVES))
    shuts = limits or there & SHUTS
    if there & SHUTS and mechanism == "pendulum":
        mechanism = "door"
    rate, recorded = r.choice(list(DURATION)), r.choice(RECORDED)
    drive = r.choice(DRIVES[mechanism])
    if there & (OF_DRIVES | {"dead_band", "slew", "lost_commands"}) and drive == "effort" or there & {"backlash", "joint_elasticity"}:
        drive = "command_effort"
    # A servo's own loop sees what its encoder says, and is not stable behind a lag; an empty voltage is an open circuit.
    of_loop = {"encoder_offset", "sensor_drift", "clock_skew", "transport_delay", "lost_commands", "actuator_lag"}
    if there & of_loop and drive == "command_position":
        drive = "command_effort"
    if recorded == "with slow commands" and drive in ("command_voltage", "effort"):
        recorded = "evenly"
    turns = mechanism != "slide"
    mass, lever = (r.uniform(0.5, 4), r.uniform(0.15, 0.4)) if turns else (r.uniform(1, 6), 0.0)
    central = mass * lever**2 * r.uniform(0.1, 0.35) if turns else 0.01
    inertia, reach, speed = (central + mass * lever**2, 1.0, 3.0) if turns else (mass, 0.25, 0.8)
    weight = mass * 9.81 * lever if mechanism == "pendulum" else 0.0
    known = {
        "damping": inertia * r.uniform(0.1, 0.5) if r.random() < 0.5 and "viscous_friction" not in there or "thermal_wear" in there else 0.0,
        "friction": inertia * r.uniform(0.1, 0.6) if r.random() < 0.5 and not there & OWN_FRICTION or "thermal_wear" in there else 0.0,
    }
    size = {"effort": inertia * 8 * reach + 0.5 * weight, "speed": speed, "reach": reach, "inertia": inertia, "mass": mass, "weight": weight}
    parameters = (draw_outside if outside else draw)(r, size)
    effects = {name: parameters[name] for name in chosen}
    # Within the tolerances that model.yaml has by default.
    m, at = mass * r.uniform(0.985, 1.015), lever + (r.uniform(-0.003, 0.003) if turns else 0.0)
    true = {name: value * r.uniform(0.85, 1.15) for name, value in known.items()}
    true |= {"inertia": central * m / mass + m * at**2 if turns else m, "sine": m * 9.81 * at if weight else 0.0, "cosine": 0.0}
    if p := effects.get("payload"):
        true["inertia"] += p["mass"] * (p["x"] ** 2 + p["z"] ** 2)
        true["sine"] -= p["mass"] * 9.81 * p["z"]
        true["cosine"] = p["mass"] * 9.81 * p["x"]
    if p := effects.get("armature_inertia"):
        true["inertia"] += p["inertia"]
    noise, effort_noise = r.choice([2e-5, 2e-4, 1e-3]) * reach, size["effort"] * r.choice([0.001, 0.01, 0.03])
    pace = [inertia * r.uniform(200, 600), inertia * r.uniform(10, 30)]
    motor = [r.uniform(0.3, 1.0) * math.sqrt(inertia / 0.05), r.uniform(2, 6)]
    law = {
        "command_effort": "{kind: torque}",
        "command_position": f"{{kind: position_servo, stiffness: {pace[0]:.6f}, damping: {pace[1]:.6f}}}",
        "command_voltage": f"{{kind: dc_motor, torque_constant: {motor[0]:.6f}, resistance: {motor[1]:.6f}}}",
    }.get(drive)
    name = named(k, chosen)
    folder = out / name
    folder.mkdir(parents=True, exist_ok=True)
    center = {"pendulum": f"0 0 {-lever:.6f}", "door": f"{lever:.6f} 0 0", "slide": "0 0 0"}[mechanism]
    low, high = (0.0, 3.0 * reach) if limits else (-20.0, 20.0)
    (folder / "object.urdf").write_text(
        f"""<robot name="thing">
  <link name="base"/>
  <link name="body">
    <inertial><origin xyz="{center}"/><mass value="{mass:.6f}"/>
      <inertia ixx="{central:.8f}" iyy="{central:.8f}" izz="{central:.8f}" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="{JOINT}" type="{'revolute' if turns else 'prismatic'}">
    <origin xyz="0 0 1"/><parent link="base"/><child link="body"/><axis xyz="{AXIS[mechanism]}"/>
    <limit lower="{low}" upper="{high}" effort="1000" velocity="100"/><dynamics damping="{known['damping']:.6f}" friction="{known['friction']:.6f}"/>
  </joint>
</robot>
"""
    )
    (folder / "model.yaml").write_text("schema: 1\nname: thing\n" + (f"actuators:\n- joint: {JOINT}\n  law: {law}\n" if law else ""))
    middle = 0.45 * reach if shuts else 0.0
    # What sits somewhere sits where the joint comes by; a stop is there already.
    for placed in there & {"detent", "position_dependent_friction"}:
        effects[placed]["position"] += middle
    joint = Joint(effects, known, true, limits, reach)
    session = there & {"thermal_wear", "sensor_drift"}
    delay = effects.get("transport_delay", {}).get("delay", 0.0)
    each = effects.get("lost_commands", {}).get("each", 1)
    for kind in ("sines", "steps", "chirp", "mixed"):
        wanted, period, count = way_of(r, kind, DURATION[rate]), 1 / rate, DURATION[rate] * rate
        times = [i * period for i in range(count + 1)]
        if recorded == "unevenly":
            times = [0.0] + [round(t + r.uniform(-0.3, 0.3) * period, 4) for t in times[1:]]
        joint.lasts = times[-1]
        joint.start(middle + 0.15 * reach * r.uniform(-1, 1))
        rows, command = [], 0.0
        for i, t in enumerate(times[:-1]):
            if recorded != "with slow commands" or i % 5 == 0:
                goal = middle + reach * wanted(t) * (0.5 if shuts else 1.0)
                push = inertia * (25 * (goal - joint.q) - 4 * joint.v) + 0.9 * weight * math.sin(joint.q)
                command = {"command_position": goal, "command_voltage": motor[1] / motor[0] * push + motor[0] * joint.v}.get(drive, push)
            rows.append((t, joint.q, joint.v, command))
            for s in range(round((times[i + 1] - t) / STEP)):
                now = t + s * STEP
                sent = now - delay
                arrived = (bisect.bisect_right(times, sent + 1e-9) - 1) // each * each
                c = rows[arrived][3] if sent >= 0 else 0.0
                tau = {
                    "command_position": pace[0] * (c - joint.q) - pace[1] * joint.v,
                    "command_voltage": motor[0] * (c - motor[0] * joint.v) / motor[1],
                }.get(drive, c)
                joint.step(joint.session + now, tau)
        held_out = kind == "mixed"
        write(folder / ("held_out.csv" if held_out else f"train_{kind}.csv"), r, joint, rows, times, drive, recorded, (noise, effort_noise), session, speed)
        joint.session += times[-1]
    sealed = {"effects": effects, "mechanism": mechanism, "drive": drive, "rate": rate, "recorded": recorded, "noise": noise}
    (out / "sealed").mkdir(exist_ok=True)
    (out / "sealed" / f"{name}.json").write_text(json.dumps(sealed, indent=1))


def read_at(t, times, states):
    """The position at another time, by positions and velocities of the rows to both sides (Hermite)."""
    t = min(max(t, 0.0), times[len(states) - 1])
    j = min(bisect.bisect_right(times, t) - 1, len(states) - 2)
    h, (q0, v0), (q1, v1) = times[j + 1] - times[j], states[j], states[j + 1]
    x = (t - times[j]) / h
    return (1 + 2 * x) * (1 - x) ** 2 * q0 + x * (1 - x) ** 2 * h * v0 + x * x * (3 - 2 * x) * q1 + x * x * (x - 1) * h * v1


def in_steps(q, noise):
    """What an encoder reads; a quiet one has finer steps."""
    step = 1.5e-3 if noise > 1e-4 else 1e-4
    return round(q / step) * step


def write(path, r, joint, rows, times, drive, recorded, noise, session, speed):
    """What is measured. A clock that is off reads the joint at another time than it says."""
    skew, offset, drift = (joint.effects.get(name) for name in ("clock_skew", "encoder_offset", "sensor_drift"))
    lines = [f"time,{JOINT}.position,{JOINT}.{drive}" + (f",{JOINT}.velocity" if recorded == "with noisy velocities" else "")]
    states = [row[1:3] for row in rows]
    for i, (t, q, v, c) in enumerate(rows):
        if skew:
            q = read_at(t - skew["skew"], times, states)
        if offset:
            q += offset["offset"]
        if drift:
            q += drift["bias"] + drift["rate"] * (joint.session + t)
        q += r.gauss(0, noise[0])
        if recorded == "in encoder steps":
            q = in_steps(q, noise[0])
        if recorded == "with lost rows" and r.random() < 0.04:
            continue
        read = c + (r.gauss(0, noise[1]) if drive == "effort" else 0.0)
        cell = "" if recorded == "with slow commands" and i % 5 else f"{read:.7g}"
        line = f"{t + (joint.session if session else 0.0):.6f},{q:.8f},{cell}"
        lines.append(line + (f",{v + r.gauss(0, 0.02 * speed):.6f}" if recorded == "with noisy velocities" else ""))
    path.write_text("\n".join(lines) + "\n")


def most_told(sets, hidden):
    """How many of the hidden effects are told, each by an answer of its own."""
    if not sets:
        return 0
    rest = sets[1:]
    return max([most_told(rest, hidden)] + [1 + most_told(rest, hidden - {name}) for name in sets[0] if name in hidden])


def ask(sagci, out, name):
    folder, answers = out / name, out / "answers"
    answers.mkdir(exist_ok=True)
    data = sorted(str(f) for f in folder.glob("train_*.csv"))
    command = [sagci, "gap", str(folder / "object.urdf"), "--data", *data, "--held-out", str(folder / "held_out.csv"), "--format", "json"]
    done = subprocess.run(command, capture_output=True, text=True)
    truth = json.loads((out / "sealed" / f"{name}.json").read_text())
    if done.returncode != 0:
        return "refused", f"{name}: {done.stderr.strip()[-200:]}"
    (answers / f"{name}.json").write_text(done.stdout)
    answer = json.loads(done.stdout)
    sets = [[e["name"], *e["alternatives"]] for e in answer["effects"]]
    hidden = set(truth["effects"]) - {"clean"}
    found = most_told(sets, hidden)
    if hidden & set(OUTSIDE):
        how = "wrong" if sets else "right" if answer["verdict"] == "unknown" else "nothing"
    elif not hidden:
        how = "right" if answer["verdict"] == "no_gap" else "wrong"
    elif found == len(sets) == len(hidden):
        how = "right" if all(len(s) == 1 for s in sets) else "in the set"
    elif found == len(sets):
        how = "part of it" if sets else "nothing"
    else:
        how = "beside others" if found else "wrong"
    said = " + ".join("|".join(s) for s in sets) or answer["verdict"]
    setting = f"{truth['mechanism']}, {truth['drive']}, {truth['rate']} Hz, {truth['recorded']}"
    return how, f"{name:32} {how:13} {said} ({setting}; {answer['seconds']:.1f} s)"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--count", type=int, default=len(EFFECTS), help="recordings, the effects in turns")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--effects", type=int, default=1, choices=[1, 2, 3], help="how many are there at once")
    parser.add_argument("--first", type=int, default=0, help="number of the first recording")
    parser.add_argument("--limits", action="store_true", help="joints reach a limit that gives way")
    parser.add_argument("--outside", action="store_true", help="what no catalogue has")
    parser.add_argument("--sagci", help="program to ask")
    given = parser.parse_args()
    counts = {}
    for k in range(given.first, given.first + given.count):
        make(given.out, k, given.seed, given.effects, given.limits, given.outside)
        if given.sagci:
            how, line = ask(given.sagci, given.out, named(k, drawn(k, given.seed, given.effects, given.outside)))
            counts[how] = counts.get(how, 0) + 1
            print(line, flush=True)
    print(", ".join(f"{how}: {n}" for how, n in sorted(counts.items())))


if __name__ == "__main__":
    main()
