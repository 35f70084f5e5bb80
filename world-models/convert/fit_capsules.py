#!/usr/bin/env python3
"""Fits a few capsules around a convex hull: the search that gave the figures in panda.py.

    python3 fit_capsules.py HULL.stl COUNT [STEPS]

Random steps from several starts; a step is kept if it lowers the cost: points of the hull that stick out (dear), and by
how much the capsules' own surfaces stand away from the hull, on average and at worst. Takes minutes a link.
"""

import random
import sys

from common import *


def sample(hull, count, rng):
    areas = [norm(cross(sub(b, a), sub(c, a))) for a, b, c in hull]
    points = [p for t in hull for p in t]
    for a, b, c in rng.choices(hull, areas, k=count):
        u, v = sorted((rng.random(), rng.random()))
        points.append(tuple(a[k] * u + b[k] * (v - u) + c[k] * (1 - v) for k in range(3)))
    return points


def distance(p, capsule):
    a, d = capsule[0:3], sub(capsule[3:6], capsule[0:3])
    t = max(0.0, min(1.0, dot(sub(p, a), d) / max(dot(d, d), 1e-12)))
    return norm(sub(p, add(a, mul(d, t)))) - capsule[6]


def surface(capsule):
    a, b, r = capsule[0:3], capsule[3:6], capsule[6]
    length = norm(sub(b, a))
    R = rotation_taking_z_to(sub(b, a)) if length > 1e-9 else IDENTITY
    points = [add(b, matvec(R, (0, 0, r))), add(a, matvec(R, (0, 0, -r)))]
    for i in range(12):
        c, s = math.cos(i * math.pi / 6), math.sin(i * math.pi / 6)
        rings = [(r, length * k / 4) for k in range(5)]
        rings += [(r * math.cos(e), length + r * math.sin(e)) for e in (0.4, 0.8, 1.2)]
        rings += [(r * math.cos(e), -r * math.sin(e)) for e in (0.4, 0.8, 1.2)]
        points += [add(a, matvec(R, (q * c, q * s, z))) for q, z in rings]
    return points


def cost(capsules, points, planes):
    out = [min(distance(p, c) for c in capsules) for p in points]
    over = []
    for i, c in enumerate(capsules):
        for p in surface(c):
            if all(j == i or distance(p, other) > -1e-6 for j, other in enumerate(capsules)):
                over.append(max(0.0, max(dot(n, p) - d for n, d in planes)))
    missed = sum(max(0.0, o - 0.0005) ** 2 for o in out) * 2e4 / len(out) + 40 * max(0.0, max(out) - 0.001)
    return missed + 2 * max(0.0, max(over) - 0.006) + sum(over) / len(over)


def fit(hull, count, steps, rng):
    points = sample(hull, 400, rng)
    planes = []
    for a, b, c in hull:
        n = cross(sub(b, a), sub(c, a))
        if norm(n) > 1e-12:
            planes.append((unit(n), dot(unit(n), a)))
    low, high = ([f(p[k] for p in points) for k in range(3)] for f in (min, max))
    best = None
    for _ in range(6):
        x = [[low[k % 3] + (high[k % 3] - low[k % 3]) * rng.uniform(0.15, 0.85) for k in range(6)] + [0.05] for _ in range(count)]
        value, width, kept = cost(x, points, planes), 0.03, 0
        for step in range(1, steps + 1):
            y = [list(c) for c in x]
            for _ in range(rng.randint(1, 4)):
                rng.choice(y)[rng.randrange(7)] += rng.gauss(0, width)
            if min(c[6] for c in y) < 0.01:
                continue
            new = cost(y, points, planes)
            if new < value:
                x, value, kept = y, new, kept + 1
            if step % 300 == 0:
                width, kept = max(0.0002, width * (1.15 if kept > 40 else 0.8)), 0
        if best is None or value < best[0]:
            best = (value, x)
    return best


if __name__ == "__main__":
    value, capsules = fit(read_stl(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]) if len(sys.argv) > 3 else 9000, random.Random(1))
    print(f"# cost {value:.5f}")
    for c in capsules:
        print(f"({tuple(round(v, 4) for v in c[0:3])}, {tuple(round(v, 4) for v in c[3:6])}, {c[6]:.4f}),")
