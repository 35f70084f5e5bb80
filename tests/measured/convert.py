#!/usr/bin/env python3
"""Converts published measurements into the CSV that this project reads. Run once; what it wrote is checked in.

    convert.py ORIGINALS [OUT]

ORIGINALS holds the folders bam_xl330, pr2_ikea_cabinet, uw_pendulum and dfki_pendulum with the files that each README names.
No sample is filtered, thinned or left out. Nothing but Python's standard library is needed.
"""

import csv
import json
import math
import sys
from pathlib import Path


def number(value, digits=9):
    """As few digits as tell it apart at this precision; nothing for a sample that is missing."""
    return "" if value is None else f"{value:.{digits}g}"


def write(path, header, rows, remarks):
    with open(path, "w", newline="\n") as out:
        out.writelines(f"# {remark}\n" for remark in remarks)
        out.write(",".join(header) + "\n")
        for row in rows:
            out.write(",".join(number(v) for v in row) + "\n")


def table(path):
    with open(path, newline="") as text:
        return [{k: float(v) for k, v in row.items()} for row in csv.DictReader(text)]


def xl330(source, out):
    """The servo's law: duty = clip(kp eg (goal - q), -1, 1), voltage = duty vin; an open circuit while the torque is off."""
    gain = 4096 / (2 * math.pi) / (256 * 885)
    for path in sorted(source.glob("*.json")):
        run = json.loads(path.read_text())
        rows = []
        for e in run["entries"]:
            duty = max(-1.0, min(1.0, run["kp"] * gain * (e["goal_position"] - e["position"])))
            rows.append([e["timestamp"], e["position"], e["speed"], duty * run["vin"] if e["torque_enable"] else None])
        name = f"kp{run['kp']}_{run['trajectory']}.csv"
        header = ["time", "pivot.position", "pivot.velocity", "pivot.command_voltage"]
        write(out / name, header, rows, [f"{path.name}: kp {run['kp']}, {run['trajectory']}, vin {run['vin']} V"])


def solve(rows, right):
    """Gauss-Jordan with pivots."""
    size = len(right)
    m = [list(r) + [b] for r, b in zip(rows, right)]
    for i in range(size):
        p = max(range(i, size), key=lambda k: abs(m[k][i]))
        m[i], m[p] = m[p], m[i]
        for k in range(size):
            if k != i:
                f = m[k][i] / m[i][i]
                m[k] = [a - f * b for a, b in zip(m[k], m[i])]
    return [m[i][size] / m[i][i] for i in range(size)]


def circle(points):
    """Centre and radius of the circle of least squares (Kasa 1976): x^2 + y^2 = a x + b y + c, about the points' mean."""
    mean = [sum(p[k] for p in points) / len(points) for k in (0, 1)]
    local = [(x - mean[0], y - mean[1], 1.0) for x, y in points]
    normal = [[sum(p[i] * p[j] for p in local) for j in range(3)] for i in range(3)]
    right = [sum(p[i] * (p[0] ** 2 + p[1] ** 2) for p in local) for i in range(3)]
    a, b, c = solve(normal, right)
    return mean[0] + a / 2, mean[1] + b / 2, math.sqrt(c + (a * a + b * b) / 4)


def pr2(source, out):
    """The door's angle is that of the hand about the centre of its path, seen from above; its effort the hand's tangential push.

    The wrist's sensor tells the force of the door on the hand: the hand's force on the door is the opposite. There is no clock: the
    robot's own estimate has one row for each control step of 0.1 s, and the samples are spread evenly over these steps.
    """
    samples = table(source / "ikea_cabinet_2_samples.csv")
    steps = len(table(source / "ikea_cabinet_2_online_estimate.csv"))
    points = [(s["ee_x_m"], s["ee_y_m"]) for s in samples]
    x, y, radius = circle(points)
    heading = [math.atan2(p[1] - y, p[0] - x) for p in points]
    for i in range(1, len(heading)):
        heading[i] = heading[i - 1] + math.remainder(heading[i] - heading[i - 1], 2 * math.pi)
    opening = math.copysign(1.0, heading[-1] - heading[0])
    rows = []
    for i, (s, angle) in enumerate(zip(samples, heading)):
        tangent = (-math.sin(angle) * opening, math.cos(angle) * opening)
        push = -(s["f_ati_x_N"] * tangent[0] + s["f_ati_y_N"] * tangent[1])
        rows.append([i * 0.1 * steps / len(samples), opening * (angle - heading[0]), push * radius])
    remarks = [f"{len(samples)} samples over {steps} steps of 0.1 s; circle of the hand: radius {radius:.4f} m"]
    write(out / "pull_1.csv", ["time", "hinge.position", "hinge.effort"], rows, remarks)


def uw(source, out):
    for path in sorted(source.glob("*.csv")):
        rows = [[r["time"], r["pivot.position"], r["pivot.velocity"]] for r in table(path)]
        write(out / path.name, ["time", "pivot.position", "pivot.velocity"], rows, [path.name])


def dfki(source, out):
    for path in sorted(source.glob("*.csv")):
        rows = [[r["time"], r["position"], r["velocity"], r["torque"]] for r in table(path)]
        header = ["time", "pivot.position", "pivot.velocity", "pivot.effort"]
        write(out / path.name.removeprefix("control_method_"), header, rows, [path.name])


def main():
    source = Path(sys.argv[1])
    out = Path(sys.argv[2]) if len(sys.argv) > 2 else Path(__file__).parent
    xl330(source / "bam_xl330", out / "xl330_servo")
    pr2(source / "pr2_ikea_cabinet", out / "pr2_cabinet")
    uw(source / "uw_pendulum", out / "uw_pendulum")
    dfki(source / "dfki_pendulum", out / "dfki_pendulum")


if __name__ == "__main__":
    main()
