"""Recordings of an arm of two joints, at one of which an effect is hidden, and how `sagci gap` answers to them.

    python3 tests/peers/two_joints.py OUT [--count 28] [--first 0] [--seed 1] [--own-clocks] [--sagci target/release/sagci]

Needs nothing but Python, and `one_joint.py` beside it: its effects, its files and its way of asking. The arm's equations are written out
for two links that turn about parallel axes, level or upright; steps are those of `one_joint.py`, and both joints' dry friction is the
impulses that together may stop them (projected Gauss-Seidel). An answer at the other joint is wrong. A clock that is off reads both joints, or
with --own-clocks one of them.
"""
import argparse
import bisect
import json
import math
import pathlib
import random

import one_joint
from one_joint import OF_WEIGHT, OWN_FRICTION, STEP, Joint, draw, in_steps, read_at, way_of

NAMES = ["shoulder", "elbow"]
# Nothing shuts here.
EFFECTS = [e for e in one_joint.EFFECTS if e not in ("magnetic_gasket", "soft_close_damper")]
DURATION = {100: 12, 200: 10, 500: 6}
RECORDED = ["evenly", "unevenly", "with lost rows", "in encoder steps", "with noisy velocities"]
# A servo's own loop sees what its encoder says.
COMMANDED = {"encoder_offset", "sensor_drift", "clock_skew", "transport_delay", "backlash", "joint_elasticity"}
SWEEPS = 8


class Arm:
    """Two links that hang along -z at zero and turn about y, or lie along x and turn about z."""

    def __init__(self, r, upright):
        self.upright, self.gravity = upright, 9.81 if upright else 0.0
        self.mass, self.length = [r.uniform(1, 4), r.uniform(0.5, 2)], [r.uniform(0.25, 0.45), r.uniform(0.2, 0.4)]
        self.lever = [0.5 * length for length in self.length]
        self.central = [m * length**2 * r.uniform(0.06, 0.15) for m, length in zip(self.mass, self.length)]
        self.payload, self.armature = None, [0.0, 0.0]
        m, e = self.mass, self.lever
        self.inertia = [self.central[0] + m[0] * e[0] ** 2 + m[1] * (self.length[0] ** 2 + e[1] ** 2), self.central[1] + m[1] * e[1] ** 2]
        self.weight = [self.gravity * (m[0] * e[0] + m[1] * (self.length[0] + e[1])), self.gravity * m[1] * e[1]]

    def as_it_is(self, r):
        """The same within the tolerances that model.yaml has by default."""
        true = Arm.__new__(Arm)
        true.__dict__.update(self.__dict__)
        true.mass = [m * r.uniform(0.985, 1.015) for m in self.mass]
        true.lever = [e + r.uniform(-0.003, 0.003) for e in self.lever]
        true.central = [c * t / m for c, t, m in zip(self.central, true.mass, self.mass)]
        return true

    def dynamics(self, q, v):
        """Inertia matrix (its three entries) and the efforts of Coriolis and weight (Spong, Hutchinson and Vidyasagar, ch. 7)."""
        sine, cosine, angle = math.sin(q[1]), math.cos(q[1]), q[0] + q[1]
        m11, m12, m22, h = self.central[0] + self.mass[0] * self.lever[0] ** 2, 0.0, 0.0, 0.0
        weight = [self.mass[0] * self.gravity * self.lever[0] * math.sin(q[0]), 0.0]
        for mass, x, z, central in [(self.mass[1], 0.0, -self.lever[1], self.central[1])] + ([(*self.payload, 0.0)] if self.payload else []):
            across, turning, square = self.length[0] * (x * sine - z * cosine), self.length[0] * (z * sine + x * cosine), x * x + z * z
            m11 += central + mass * (self.length[0] ** 2 + square + 2 * across)
            m12 += central + mass * (square + across)
            m22 += central + mass * square
            h += mass * turning
            lift = mass * self.gravity * (-z * math.sin(angle) - x * math.cos(angle))
            weight[0] += mass * self.gravity * self.length[0] * math.sin(q[0]) + lift
            weight[1] += lift
        bias = [h * (2 * v[0] * v[1] + v[1] ** 2) + weight[0], weight[1] - h * v[0] ** 2]
        return (m11 + self.armature[0], m12, m22 + self.armature[1]), bias

    def step(self, joints, now, efforts):
        q, v = [j.q for j in joints], [j.v for j in joints]
        (m11, m12, m22), bias = self.dynamics(q, v)
        free = [u - b - j.true["damping"] * j.v - j.resists(now) for u, b, j in zip(efforts, bias, joints)]
        det = m11 * m22 - m12 * m12
        own, other = [m22 / det, m11 / det], -m12 / det
        v = [v[k] + STEP * (own[k] * free[k] + other * free[1 - k]) for k in range(2)]
        most = [STEP * j.dry(now, u, b, s) for j, u, b, s in zip(joints, efforts, bias, v)]
        impulse = [0.0, 0.0]
        for k in [0, 1] * (SWEEPS if any(most) else 0):
            wanted = max(-most[k], min(most[k], impulse[k] - v[k] / own[k]))
            change, impulse[k] = wanted - impulse[k], wanted
            v[k] += own[k] * change
            v[1 - k] += other * change
        for joint, speed in zip(joints, v):
            joint.v = speed
            joint.q += STEP * speed

    def urdf(self, known):
        axis, along = ("0 1 0", "0 0 {:.6f}") if self.upright else ("0 0 1", "{:.6f} 0 0")
        place = lambda x: along.format(-x if self.upright else x)
        text = '<robot name="arm">\n  <link name="base"/>\n'
        for k, name in enumerate(NAMES):
            inertia = " ".join(f'{i}="{self.central[k]:.8f}"' for i in ("ixx", "iyy", "izz")) + ' ixy="0" ixz="0" iyz="0"'
            text += f"""  <link name="link_{k}">
    <inertial><origin xyz="{place(self.lever[k])}"/><mass value="{self.mass[k]:.6f}"/><inertia {inertia}/></inertial>
  </link>
  <joint name="{name}" type="revolute">
    <origin xyz="{place(self.length[0]) if k else '0 0 1'}"/><parent link="{'link_0' if k else 'base'}"/><child link="link_{k}"/><axis xyz="{axis}"/>
    <limit lower="-20" upper="20" effort="1000" velocity="100"/>
    <dynamics damping="{known[k]['damping']:.6f}" friction="{known[k]['friction']:.6f}"/>
  </joint>
"""
        return text + "</robot>\n"


def make(out, k, seed, own_clocks):
    r = random.Random(77000 * seed + k)
    effect = EFFECTS[k % len(EFFECTS)]
    arm = Arm(r, effect in OF_WEIGHT or r.random() < 0.6)
    rate, recorded, drive = r.choice(list(DURATION)), r.choice(RECORDED), r.choice(["command_effort", "command_effort", "command_position"])
    if effect in COMMANDED:
        drive = "command_effort"
    at = 1 if effect == "payload" else r.randrange(2)
    known, rubs = [], effect == "thermal_wear"
    for j, inertia in enumerate(arm.inertia):
        some = lambda kept, share: inertia * share if (rubs and j == at) or (r.random() < 0.5 and (kept or j != at)) else 0.0
        damping, friction = some(effect != "viscous_friction", r.uniform(0.2, 0.8)), some(effect not in OWN_FRICTION, r.uniform(0.1, 0.6))
        known.append({"damping": damping, "friction": friction})
    size = {"effort": arm.inertia[at] * 8 + 0.5 * arm.weight[at], "speed": 3.0, "reach": 1.0, "inertia": arm.inertia[at], "mass": arm.mass[1],
            "weight": arm.weight[at]}
    p = draw(r, size)[effect]
    true = arm.as_it_is(r)
    if effect == "payload":
        true.payload = (p["mass"], p["x"], p["z"])
    if effect == "armature_inertia":
        true.armature = [p["inertia"] * (j == at) for j in range(2)]
    losses = [{n: x * r.uniform(0.85, 1.15) for n, x in own.items()} | {"inertia": i} for own, i in zip(known, arm.inertia)]
    joints = [Joint({effect: p} if j == at else {}, known[j], losses[j], False) for j in range(2)]
    noise = r.choice([2e-5, 2e-4, 1e-3])
    servo = [(i * r.uniform(200, 500), i * r.uniform(15, 30)) for i in arm.inertia]
    name = f"{k:03}_{effect}"
    folder = out / name
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "object.urdf").write_text(arm.urdf(known))
    law = {"command_effort": "kind: torque", "command_position": "kind: position_servo, stiffness: {:.6f}, damping: {:.6f}"}[drive]
    laws = "".join(f"- joint: {n}\n  law: {{{law.format(*gains)}}}\n" for n, gains in zip(NAMES, servo))
    (folder / "model.yaml").write_text("schema: 1\nname: arm\nactuators:\n" + laws)
    session, goes_on = 0.0, effect in ("thermal_wear", "sensor_drift")
    for kind in ("sines", "steps", "chirp", "mixed"):
        wanted, period = [way_of(r, kind, DURATION[rate]) for _ in NAMES], 1 / rate
        times = [i * period for i in range(DURATION[rate] * rate + 1)]
        if recorded == "unevenly":
            times = [0.0] + [round(t + r.uniform(-0.3, 0.3) * period, 4) for t in times[1:]]
        for joint in joints:
            joint.start(0.15 * r.uniform(-1, 1))
        rows = []
        for i, t in enumerate(times[:-1]):
            q, v = [j.q for j in joints], [j.v for j in joints]
            commands = [0.8 * w(t) for w in wanted]
            if drive == "command_effort":
                (m11, m12, m22), bias = arm.dynamics(q, [0, 0])
                a = [25 * (goal - x) - 6 * s for goal, x, s in zip(commands, q, v)]
                commands = [m11 * a[0] + m12 * a[1] + 0.9 * bias[0], m12 * a[0] + m22 * a[1] + 0.9 * bias[1]]
            rows.append((t, q, v, commands))
            for s in range(round((times[i + 1] - t) / STEP)):
                now, efforts = t + s * STEP, []
                for j, joint in enumerate(joints):
                    sent = now - joint.effects.get("transport_delay", {}).get("delay", 0.0)
                    c = rows[bisect.bisect_right(times, sent + 1e-9) - 1][3][j] if sent >= 0 else 0.0
                    efforts.append(joint.drive(servo[j][0] * (c - joint.q) - servo[j][1] * joint.v if drive == "command_position" else c))
                true.step(joints, session + now, efforts)
        file = folder / ("held_out.csv" if kind == "mixed" else f"train_{kind}.csv")
        write(file, r, rows, times, drive, recorded, noise, (effect, p, at), (session, goes_on), own_clocks)
        session += times[-1]
    of_all = effect == "clock_skew" and not own_clocks
    truth = {"effects": {effect: p}, "joint": None if of_all else NAMES[at], "mechanism": "upright arm" if arm.upright else "level arm", "drive": drive,
             "rate": rate, "recorded": recorded, "noise": noise}
    (out / "sealed").mkdir(exist_ok=True)
    (out / "sealed" / f"{name}.json").write_text(json.dumps(truth, indent=1))
    return name


def write(path, r, rows, times, drive, recorded, noise, hidden, session, own_clocks):
    """What is measured. A clock that is off reads its joints at another time than it says."""
    effect, p, at = hidden
    velocities = recorded == "with noisy velocities"
    columns = [c for n in NAMES for c in (f"{n}.position", f"{n}.{drive}", f"{n}.velocity")[: 3 if velocities else 2]]
    lines = [",".join(["time", *columns])]
    states = [[(q[j], v[j]) for _, q, v, _ in rows] for j in range(2)]
    for t, q, v, commands in rows:
        q = list(q)
        if effect == "clock_skew":
            q = [read_at(t - p["skew"], times, states[j]) if j == at or not own_clocks else q[j] for j in range(2)]
        if effect == "encoder_offset":
            q[at] += p["offset"]
        if effect == "sensor_drift":
            q[at] += p["bias"] + p["rate"] * (session[0] + t)
        if recorded == "with lost rows" and r.random() < 0.04:
            continue
        cells = [f"{t + (session[0] if session[1] else 0.0):.6f}"]
        for position, command, speed in zip(q, commands, v):
            position += r.gauss(0, noise)
            if recorded == "in encoder steps":
                position = in_steps(position, noise)
            cells += [f"{position:.8f}", f"{command:.7g}"] + ([f"{speed + r.gauss(0, 0.05):.6f}"] if velocities else [])
        lines.append(",".join(cells))
    path.write_text("\n".join(lines) + "\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--count", type=int, default=len(EFFECTS), help="recordings, the effects in turns")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--own-clocks", action="store_true", help="a clock that is off reads one joint alone")
    parser.add_argument("--sagci", help="program to ask")
    given = parser.parse_args()
    counts = {}
    for k in range(given.first, given.first + given.count):
        name = make(given.out, k, given.seed, given.own_clocks)
        if not given.sagci:
            continue
        how, line = one_joint.ask(given.sagci, given.out, name)
        if how in ("right", "in the set"):
            answer = json.loads((given.out / "answers" / f"{name}.json").read_text())
            truth = json.loads((given.out / "sealed" / f"{name}.json").read_text())
            of_base = {"unmodelled_mode"}
            if any(e["joint"] != truth["joint"] for e in answer["effects"] if e["name"] not in of_base):
                how, line = "wrong joint", line + " AT THE OTHER JOINT"
        counts[how] = counts.get(how, 0) + 1
        print(line, flush=True)
    print(", ".join(f"{how}: {n}" for how, n in sorted(counts.items())))


if __name__ == "__main__":
    main()
