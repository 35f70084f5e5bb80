"""Furniture of another make, seen by another camera, and how `sagci perceive` answers to it.

    python3 tests/peers/furniture.py OUT [--count 60] [--seed 1] [--sagci target/release/sagci]

Needs numpy. Nothing here is shared with `kernel/furniture`: neither shapes, nor camera, nor noise. Objects are boxes and balls;
clouds are one view, three views in one world cloud, or one to three views in their cameras' frames with poses. Things stand alone, on a floor
that is seen for 1 to 12 m around, on a table, or in a room; doors alone or in a wall. Truth: a wall around a door belongs to nothing.

OUT/NAME/ holds the clouds (PLY) and, where there are cameras, poses.json; OUT/sealed/NAME.json the truth.
"""
import argparse
import json
import math
import pathlib
import subprocess

import numpy as np

CATEGORIES = ["box", "door", "microwave", "oven", "refrigerator", "storage"]
SEEN = ["one view", "three views", "camera frame"]


class Part:
    def __init__(self, kind, type_=None, axis=None, origin=None, lower=0.0, upper=1.5):
        self.kind, self.type, self.axis, self.origin, self.lower, self.upper = kind, type_, axis, origin, lower, upper
        self.boxes, self.balls, self.q = [], [], 0.0

    def box(self, low, high):
        low, high = np.minimum(low, high).astype(float), np.maximum(low, high).astype(float)
        self.boxes.append((low, high))
        return self

    def ball(self, center, radius):
        self.balls.append((np.array(center, float), radius))
        return self

    def pose(self):
        """R, p of the part at its state."""
        R, p = np.eye(3), np.zeros(3)
        if self.type == "prismatic":
            p = np.array(self.axis, float) * self.q
        elif self.type == "revolute":
            R = turn(self.axis, self.q)
            p = np.array(self.origin, float) - R @ np.array(self.origin, float)
        return R, p


def turn(axis, angle):
    a = np.array(axis, float)
    K = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    return np.eye(3) + math.sin(angle) * K + (1 - math.cos(angle)) * K @ K


# ---- objects: x to the right, y into the object (its front at y = 0), z up ------------------------------------------------------------

def shell(part, x0, x1, y0, y1, z0, z1, t, front_open=True, top=True):
    part.box((x0, y0, z0), (x0 + t, y1, z1)).box((x1 - t, y0, z0), (x1, y1, z1))
    part.box((x0, y1 - t / 2, z0), (x1, y1, z1)).box((x0, y0, z0), (x1, y1, z0 + t))
    if top:
        part.box((x0, y0, z1 - t), (x1, y1, z1))
    if not front_open:
        part.box((x0, y0, z0), (x1, y0 + t, z1))


def pull(r, part, kind, x, z, y, upright, length):
    """A handle on a front at y: its middle at (x, z)."""
    if kind == "knob":
        radius = r.uniform(0.011, 0.018)
        part.box((x - 0.005, y - 0.015, z - 0.005), (x + 0.005, y, z + 0.005)).ball((x, y - 0.015 - radius * 0.6, z), radius)
    elif kind == "bar":
        w, out = r.uniform(0.008, 0.02), r.uniform(0.025, 0.055)
        h = length / 2
        if upright:
            part.box((x - w / 2, y - out - w, z - h), (x + w / 2, y - out, z + h))
            for s in (-1, 1):
                part.box((x - w / 2, y - out, z + s * h * 0.85 - w / 2), (x + w / 2, y, z + s * h * 0.85 + w / 2))
        else:
            part.box((x - h, y - out - w, z - w / 2), (x + h, y - out, z + w / 2))
            for s in (-1, 1):
                part.box((x + s * h * 0.85 - w / 2, y - out, z - w / 2), (x + s * h * 0.85 + w / 2, y, z + w / 2))
    elif kind == "cup":
        w = 0.045
        part.box((x - w, y - 0.022, z), (x + w, y, z + 0.004)).box((x - w, y - 0.022, z - 0.018), (x + w, y - 0.019, z))
        for s in (-1, 1):
            part.box((x + s * w - 0.002, y - 0.022, z - 0.018), (x + s * w + 0.002, y, z))
    elif kind == "lip":
        if upright:
            part.box((x - 0.004, y - 0.02, z - length / 2), (x + 0.004, y, z + length / 2))
        else:
            part.box((x - length / 2, y - 0.02, z - 0.004), (x + length / 2, y, z + 0.004))


def panel(r, part, x0, x1, z0, z1, y, t, style):
    """A front from y (outside) to y + t."""
    if style == "shaker" and min(x1 - x0, z1 - z0) > 0.16:
        f, d = min(0.06, 0.2 * min(x1 - x0, z1 - z0)), 0.006
        part.box((x0, y + d, z0), (x1, y + t, z1))
        for a, b in (((x0, z0), (x0 + f, z1)), ((x1 - f, z0), (x1, z1)), ((x0 + f, z0), (x1 - f, z0 + f)), ((x0 + f, z1 - f), (x1 - f, z1))):
            part.box((a[0], y, a[1]), (b[0], y + d, b[1]))
    else:
        part.box((x0, y, z0), (x1, y + t, z1))


def hinged(r, kind, x0, x1, z0, z1, y, t, side, style, handle, open_to=None):
    """A panel that opens outward about its left, right, lower or upper edge. The hinge sits at the outer or inner face's edge."""
    inner = r.choice([0.0, 1.0, 0.5])
    yh = y + t * inner
    axis, origin = {
        "left": ((0, 0, -1), (x0, yh, (z0 + z1) / 2)),
        "right": ((0, 0, 1), (x1, yh, (z0 + z1) / 2)),
        "bottom": ((1, 0, 0), ((x0 + x1) / 2, yh, z0)),
        "top": ((-1, 0, 0), ((x0 + x1) / 2, yh, z1)),
    }[side]
    part = Part(kind, "revolute", axis, origin, 0.0, open_to or r.uniform(1.5, 2.2))
    panel(r, part, x0, x1, z0, z1, y, t, style)
    inset = r.uniform(0.03, 0.06)
    inset = min(inset, 0.25 * (x1 - x0), 0.25 * (z1 - z0))
    if side in ("left", "right"):
        x = x1 - inset if side == "left" else x0 + inset
        z = z0 + (z1 - z0) * r.choice([0.5, 0.5, 0.3, 0.7])
        pull(r, part, handle, x, z, y, True, min(r.uniform(0.1, 0.3), 0.6 * (z1 - z0)))
    else:
        z = z1 - inset if side == "bottom" else z0 + inset
        pull(r, part, handle, (x0 + x1) / 2, z, y, False, min(r.uniform(0.12, 0.5), 0.75 * (x1 - x0)))
    return part


def drawer(r, x0, x1, z0, z1, y, t, depth, style, handle):
    part = Part("drawer", "prismatic", (0, -1, 0), ((x0 + x1) / 2, y, (z0 + z1) / 2), 0.0, depth * r.uniform(0.6, 0.85))
    panel(r, part, x0, x1, z0, z1, y, t, style)
    i, h = 0.012, (z1 - z0) * r.uniform(0.5, 0.85)
    a, b, s = x0 + i + 0.012, x1 - i - 0.012, 0.012
    part.box((a, y + t, z0 + i), (a + s, y + t + depth * 0.9, z0 + h)).box((b - s, y + t, z0 + i), (b, y + t + depth * 0.9, z0 + h))
    part.box((a, y + t + depth * 0.9 - s, z0 + i), (b, y + t + depth * 0.9, z0 + h)).box((a, y + t, z0 + i), (b, y + t + depth * 0.9, z0 + i + 0.008))
    n = 2 if handle in ("knob", "cup") and x1 - x0 > 0.6 else 1
    for k in range(n):
        x = x0 + (x1 - x0) * (k + 1) / (n + 1)
        pull(r, part, handle, x, (z0 + z1) / 2 if handle != "lip" else z1 - 0.008, y, False, min(r.uniform(0.1, 0.35), 0.6 * (x1 - x0)))
    return part


def storage(r):
    w, d, h, t = r.uniform(0.4, 1.2), r.uniform(0.35, 0.6), r.uniform(0.5, 1.2), r.uniform(0.015, 0.025)
    body = Part("body")
    base = r.choice([0.0, 0.08, 0.12])
    shell(body, 0, w, 0, d, base, base + h, t)
    if base:
        if r.random() < 0.5:
            body.box((0.03, 0.05, 0), (w - 0.03, d - 0.03, base))
        else:
            for x in (0.02, w - 0.06):
                for y in (0.02, d - 0.06):
                    body.box((x, y, 0), (x + 0.04, y + 0.04, base))
    if r.random() < 0.5:
        o = r.uniform(0.01, 0.03)
        body.box((-o, -o, base + h), (w + o, d, base + h + 0.03))
    style, handle = r.choice(["flat", "shaker"]), r.choice(["knob", "bar", "cup", "lip"])
    inset = r.random() < 0.3
    thick, g = r.uniform(0.016, 0.022), r.uniform(0.002, 0.006)
    y = 0.0 if inset else -thick
    m = t + g if inset else g
    parts = [body]
    columns = 1 if w < 0.55 else int(r.integers(1, 3))
    edges = np.linspace(0, w, columns + 1)
    for c in range(columns):
        a, b = edges[c] + (m if c == 0 else g), edges[c + 1] - (m if c == columns - 1 else g)
        if c:
            body.box((edges[c] - t / 2, 0 if not inset else thick, base), (edges[c] + t / 2, d, base + h))
        low, high = base + m, base + h - m
        plan = r.choice(["drawers", "door", "drawer over door", "open and door", "double"])
        if plan == "double" and b - a < 0.5:
            plan = "door"
        depth = d - thick - 0.03
        if plan == "drawers":
            n = int(r.integers(2, 5))
            zs = low + (high - low) * np.concatenate([[0], np.cumsum(r.uniform(0.7, 1.4, n))])
            zs = low + (zs - low) * (high - low) / (zs[-1] - low)
            for i in range(n):
                parts.append(drawer(r, a, b, zs[i] + g / 2, zs[i + 1] - g / 2, y, thick, depth, style, handle))
            continue
        if plan == "drawer over door":
            z = high - r.uniform(0.12, 0.2)
            parts.append(drawer(r, a, b, z + g, high, y, thick, depth, style, handle))
            body.box((edges[c], thick if inset else 0, z - t / 2), (edges[c + 1], d, z + t / 2))
            high = z - g
        elif plan == "open and door":
            z = high - (high - low) * r.uniform(0.3, 0.5)
            body.box((edges[c], 0, z - t / 2), (edges[c + 1], d, z + t / 2))
            for _ in range(int(r.integers(0, 4))):
                x, s = r.uniform(a + 0.05, b - 0.1), r.uniform(0.03, 0.08)
                body.box((x, d * 0.4, z + t / 2), (x + s, d * 0.7, z + t / 2 + r.uniform(0.08, 0.2)))
            high = z - t / 2 - g
        if plan == "double" or (plan != "door" and b - a > 0.7):
            x = (a + b) / 2
            parts.append(hinged(r, "door", a, x - g / 2, low, high, y, thick, "left", style, handle))
            parts.append(hinged(r, "door", x + g / 2, b, low, high, y, thick, "right", style, handle))
        else:
            side = r.choice(["left", "right"])
            if high - low < 0.45 and b - a > high - low:
                side = r.choice(["left", "right", "bottom", "top"])
            parts.append(hinged(r, "door", a, b, low, high, y, thick, side, style, handle if handle != "cup" else "knob"))
        if r.random() < 0.7:
            z = low + (high - low) * r.uniform(0.35, 0.65)
            body.box((edges[c] + t / 2, 0.03 + thick, z), (edges[c + 1] - t / 2, d - t, z + 0.016))
    return parts


def refrigerator(r):
    w, d, h = r.uniform(0.5, 0.95), r.uniform(0.55, 0.75), r.uniform(1.2, 1.9)
    body, t = Part("body"), r.uniform(0.03, 0.05)
    foot = r.uniform(0.02, 0.06)
    shell(body, 0, w, 0, d, foot, foot + h, t)
    body.box((0.04, 0.03, 0), (w - 0.04, d - 0.04, foot))
    for z in np.linspace(foot + 0.3, foot + h - 0.3, int(r.integers(2, 5))):
        body.box((t, 0.08, z), (w - t, d - t, z + 0.012))
    handle, thick, g = r.choice(["bar", "bar", "lip"]), r.uniform(0.05, 0.08), r.uniform(0.004, 0.012)
    y, low, high = -thick - 0.006, foot + 0.01, foot + h
    parts = [body]
    plan = r.choice(["one", "top freezer", "bottom freezer", "side by side", "french"])
    side = r.choice(["left", "right"])
    door = lambda a, b, z0, z1, s: parts.append(hinged(r, "door", a, b, z0, z1, y, thick, s, "flat", handle))
    if plan == "one":
        door(0, w, low, high, side)
    elif plan == "top freezer" or plan == "bottom freezer":
        z = low + (high - low) * (r.uniform(0.6, 0.72) if plan == "top freezer" else r.uniform(0.3, 0.42))
        body.box((0, 0, z - 0.02), (w, d, z + 0.02))
        door(0, w, low, z - g / 2, side)
        door(0, w, z + g / 2, high, side)
    elif plan == "side by side":
        x = w * r.uniform(0.4, 0.5)
        body.box((x - 0.02, 0, low), (x + 0.02, d, high))
        door(0, x - g / 2, low, high, "left")
        door(x + g / 2, w, low, high, "right")
    else:
        z = low + (high - low) * r.uniform(0.3, 0.4)
        body.box((0, 0, z - 0.02), (w, d, z + 0.02))
        door(0, w / 2 - g / 2, z + g / 2, high, "left")
        door(w / 2 + g / 2, w, z + g / 2, high, "right")
        parts.append(drawer(r, 0, w, low, z - g / 2, y, thick, d - thick - 0.05, "flat", "bar"))
    return parts


def microwave(r):
    w, d, h = r.uniform(0.42, 0.6), r.uniform(0.3, 0.42), r.uniform(0.24, 0.34)
    body, t, foot = Part("body"), 0.015, 0.012
    for x in (0.03, w - 0.05):
        for y in (0.03, d - 0.05):
            body.box((x, y, 0), (x + 0.02, y + 0.02, foot))
    x = w * r.uniform(0.7, 0.8)
    low, high, thick = foot, foot + h, r.uniform(0.025, 0.04)
    shell(body, 0, x, 0, d, low, high, t)
    body.box((x, -thick * r.choice([0, 1]), low), (w, d, high))
    face = body.boxes[-1][0][1]
    if r.random() < 0.6:
        for z in np.linspace(low + 0.04, low + 0.12, 3):
            for u in (0.25, 0.5, 0.75):
                body.box((x + (w - x) * u - 0.006, face - 0.002, z - 0.005), (x + (w - x) * u + 0.006, face, z + 0.005))
    if r.random() < 0.5:
        body.ball((x + (w - x) / 2, face, high - 0.06), 0.02)
    door = hinged(r, "door", 0, x - 0.003, low, high, -thick, thick, "left", "flat", r.choice(["bar", "bar", "lip"]), r.uniform(1.5, 2.0))
    if r.random() < 0.5:
        body.box((t + 0.05, 0.1, low + t), (x - 0.1, d - 0.08, low + t + 0.01))
    return [body, door]


def oven(r):
    w, d, h = r.uniform(0.55, 0.76), r.uniform(0.52, 0.65), r.uniform(0.8, 0.92)
    body, t, base = Part("body"), 0.03, r.uniform(0.05, 0.12)
    top = base + h
    strip = r.uniform(0.09, 0.14)
    low = base + r.choice([0.01, 0.18])
    shell(body, 0, w, 0, d, low, top - strip, t)
    body.box((0, -0.02, top - strip), (w, d, top))
    body.box((0.02, 0.04, 0), (w - 0.02, d - 0.02, base))
    parts = [body]
    thick = r.uniform(0.03, 0.05)
    for x in np.linspace(0.08, w - 0.08, int(r.integers(3, 6))):
        body.box((x - 0.02, -0.045, top - strip / 2 - 0.02), (x + 0.02, -0.02, top - strip / 2 + 0.02))
    for x in (0.27 * w, 0.73 * w):
        for y in (0.3 * d, 0.72 * d):
            body.box((x - 0.08, y - 0.08, top), (x + 0.08, y + 0.08, top + 0.012))
    if r.random() < 0.5:
        body.box((0, d - 0.05, top), (w, d, top + r.uniform(0.05, 0.2)))
    if low > base + 0.1:
        body.box((0, 0, base), (0.02, d, low)).box((w - 0.02, 0, base), (w, d, low))
        parts.append(drawer(r, 0, w, base, low - 0.005, -thick, thick, d - thick - 0.05, "flat", r.choice(["bar", "lip"])))
    parts.append(hinged(r, "door", 0, w, low, top - strip - 0.006, -thick, thick, "bottom", "flat", "bar", r.uniform(1.3, 1.57)))
    rack = low + (top - strip - low) * r.uniform(0.4, 0.6)
    body.box((t, 0.05, rack), (w - t, d - t, rack + 0.006))
    return parts


def door(r):
    w, h, t = r.uniform(0.65, 1.0), r.uniform(1.85, 2.15), r.uniform(0.035, 0.045)
    f, deep = r.uniform(0.05, 0.1), r.uniform(0.08, 0.15)
    frame = Part("body")
    g = r.uniform(0.003, 0.006)
    frame.box((-f, -0.01, 0), (0, deep, h + f)).box((w, -0.01, 0), (w + f, deep, h + f)).box((0, -0.01, h), (w, deep, h + f))
    side = r.choice(["left", "right"])
    leaf = hinged(r, "door", g, w - g, 0.008, h - g, 0.0, t, side, r.choice(["flat", "shaker"]), "none")
    x = w - 0.06 if side == "left" else 0.06
    s = -1 if side == "left" else 1
    if r.random() < 0.6:
        for y, o in ((0.0, -1), (t, 1)):
            leaf.box((x - 0.01, y, 1.0 - 0.01), (x + 0.01, y + o * 0.05, 1.01))
            leaf.box((x - 0.01 * s, y + o * 0.05, 0.99), (x + s * 0.12, y + o * 0.035, 1.01))
    else:
        for y, o in ((0.0, -1), (t, 1)):
            leaf.box((x - 0.012, y, 0.99), (x + 0.012, y + o * 0.03, 1.01)).ball((x, y + o * 0.045, 1.0), 0.028)
    return [frame, leaf]


def chest(r):
    w, d, h, t = r.uniform(0.25, 0.9), r.uniform(0.2, 0.5), r.uniform(0.15, 0.5), r.uniform(0.008, 0.02)
    body = Part("body")
    shell(body, 0, w, 0, d, 0, h, t, front_open=False, top=False)
    kind = r.choice(["slab", "cap", "flaps"])
    if kind == "flaps":
        q = r.uniform(2.0, 3.6)
        a = Part("flap", "revolute", (1, 0, 0), (w / 2, 0, h), 0, q).box((0, 0, h), (w, d / 2 - 0.003, h + 0.005))
        b = Part("flap", "revolute", (-1, 0, 0), (w / 2, d, h), 0, q).box((0, d / 2 + 0.003, h), (w, d, h + 0.005))
        return [body, a, b]
    lid = Part("lid", "revolute", (-1, 0, 0), (w / 2, d, h), 0, r.uniform(1.2, 2.0))
    o = r.uniform(0, 0.015)
    lid.box((-o, -o, h), (w + o, d, h + t))
    if kind == "cap":
        rim = r.uniform(0.03, 0.08)
        lid.box((-o - 0.008, -o - 0.008, h - rim), (-o, d, h + t)).box((w + o, -o - 0.008, h - rim), (w + o + 0.008, d, h + t))
        lid.box((-o, -o - 0.008, h - rim), (w + o, -o, h + t))
    elif r.random() < 0.5:
        lid.box((w / 2 - 0.03, -o - 0.012, h - 0.02), (w / 2 + 0.03, -o, h + t))
    for _ in range(int(r.integers(0, 3))):
        x, s = r.uniform(t, w - 0.08), r.uniform(0.03, 0.07)
        body.box((x, d * 0.4, t), (x + s, d * 0.4 + s, t + s))
    return [body, lid]


MAKE = {"box": chest, "door": door, "microwave": microwave, "oven": oven, "refrigerator": refrigerator, "storage": storage}

# ---- seeing ---------------------------------------------------------------------------------------------------------------------------


def rays(parts, R_WF, p_WF, eye, directions):
    """Distance, part and cosine along each ray of unit length; world frame."""
    n = len(directions)
    best, which, cosine = np.full(n, np.inf), np.full(n, -2), np.zeros(n)
    for index, part in enumerate(parts):
        R, p = part.pose()
        R, p = R_WF @ R, R_WF @ p + p_WF
        o, d = R.T @ (eye - p), directions @ R
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1 / np.where(np.abs(d) < 1e-12, 1e-12, d)
            for low, high in part.boxes:
                a, b = (low - o) * inverse, (high - o) * inverse
                near, far = np.minimum(a, b), np.maximum(a, b)
                enter, side, leave = near.max(1), near.argmax(1), far.min(1)
                hit = (enter < leave) & (enter > 0.05) & (enter < best)
                best[hit], which[hit] = enter[hit], index
                cosine[hit] = np.abs(d[np.arange(n), side])[hit]
            for center, radius in part.balls:
                v = o - center
                b, c = d @ v, v @ v - radius**2
                disc = b * b - c
                t = -b - np.sqrt(np.maximum(disc, 0))
                hit = (disc > 0) & (t > 0.05) & (t < best)
                best[hit], which[hit], cosine[hit] = t[hit], index, (np.sqrt(np.maximum(disc, 0)) / radius)[hit]
    return best, which, cosine


def looking(eye, at):
    z = (at - eye) / np.linalg.norm(at - eye)
    x = np.cross(z, [0, 0, 1.0])
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], 1)


def bounds(parts):
    points = []
    for part in parts:
        R, p = part.pose()
        for low, high in part.boxes:
            for k in range(8):
                corner = np.array([(low, high)[(k >> i) & 1][i] for i in range(3)])
                points.append(R @ corner + p)
    points = np.array(points)
    return points.min(0), points.max(0)


def surroundings(r, where, category, low, high):
    """Boxes around an object of these bounds, in its frame with z along the world's."""
    far = r.choice([1.0, 4.0, 12.0])
    w, d = high[0] - low[0], high[1] - low[1]
    boxes = []
    if where == "floor" or where == "room":
        boxes.append(((low[0] - far, low[1] - far, low[2] - 0.1), (high[0] + far, high[1] + far, low[2])))
    if where == "table":
        a, b, c = r.uniform(0.1, 0.6, 3)
        boxes.append(((low[0] - a, low[1] - b, low[2] - 0.03), (high[0] + c, high[1] + 0.2, low[2])))
    if where == "room":
        gap = r.choice([0.0, 0.03, 0.1])
        boxes.append(((low[0] - far, high[1] + gap, low[2]), (high[0] + far, high[1] + gap + 0.1, low[2] + 2.6)))
    if where == "wall":
        # A door's: around its frame.
        t = 0.12
        left, right, top = low[0] - 1.2, high[0] + 1.2, high[2]
        for x0, z0, x1, z1 in ((left, low[2], low[0], top), (high[0], low[2], right, top), (left, top, right, top + 0.4)):
            boxes.append(((x0, 0.0, z0), (x1, t, z1)))
        if r.random() < 0.5:
            boxes.append(((low[0] - 2, low[1] - 2, low[2] - 0.1), (high[0] + 2, high[1] + 2, low[2])))
    return boxes


def view(r, parts, R_WF, p_WF, X, size, around, quality):
    """A depth image of `size`: points in the camera's frame, labels."""
    R_WC, eye, f, w, h = X
    u, v = np.meshgrid(np.arange(w), np.arange(h))
    d = np.stack([(u.ravel() + 0.5 - w / 2) / f, (v.ravel() + 0.5 - h / 2) / f, np.ones(w * h)], 1)
    norm = np.linalg.norm(d, axis=1)
    unit = (d / norm[:, None]) @ R_WC.T
    t, which, cosine = rays(parts, R_WF, p_WF, eye, unit)
    if around:
        room = Part("body")
        room.boxes = [(np.array(low, float), np.array(high, float)) for low, high in around]
        s, hit, c = rays([room], R_WF, p_WF, eye, unit)
        behind = s < t
        t[behind], which[behind], cosine[behind] = s[behind], -1, c[behind]
    depth = t / norm
    ok = np.isfinite(depth) & (which > -2)
    depth = np.where(ok, depth, 0)
    depth = depth + r.normal(size=depth.shape) * (0.0004 + 0.001 * depth**2) * quality
    ok &= r.random(depth.shape) > np.where(cosine < 0.12, 0.8, 0.01)
    points = d * depth[:, None]
    return points[ok], which[ok]


def write_ply(path, points):
    with open(path, "wb") as file:
        properties = "".join(f"property float {axis}\n" for axis in "xyz")
        file.write(f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n{properties}end_header\n".encode())
        file.write(points.astype("<f4").tobytes())


def thinned(r, labels, most):
    """A choice of points, as dense everywhere as gives so many of the object's."""
    share = min(1.0, most / max(1, (labels >= 0).sum()))
    return r.permutation(len(labels))[: int(share * len(labels))]


def make(seed, number, root):
    r = np.random.default_rng([seed, number])
    category = CATEGORIES[number % 6]
    parts = MAKE[category](r)
    state = r.choice(["shut", "ajar", "open"])
    for part in parts[1:]:
        share = {"shut": 0.0, "ajar": r.uniform(0.03, 0.15), "open": r.uniform(0.3, 1.0)}[state]
        if state != "shut" and len(parts) > 2 and r.random() < 0.4:
            share = 0.0
        part.q = part.lower + share * (part.upper - part.lower)
    yaw, lift = r.uniform(-math.pi, math.pi), r.choice([0.0, r.uniform(0, 1.0)])
    if category == "door":
        lift = 0.0
    R_WF, p_WF = turn((0, 0, 1), yaw), np.array([r.uniform(-2, 2), r.uniform(-2, 2), lift])
    low, high = bounds(parts)
    middle, size = (low + high) / 2, np.linalg.norm(high - low)
    seen = SEEN[int(r.integers(0, len(SEEN)))]
    name = f"{number:03d}"
    folder = root / name
    folder.mkdir(parents=True, exist_ok=True)
    clouds, labels, views = [], [], []
    quality = r.uniform(0.3, 1.5)
    where = r.choice(["nothing", "nothing", "floor", "table", "room"])
    if category == "door":
        where = r.choice(["nothing", "wall"])
    if category in ("oven", "refrigerator", "storage") and where == "table":
        where = "floor"
    around = surroundings(r, where, category, low, high)
    n = {"one view": 1, "three views": 3, "camera frame": int(r.integers(1, 4))}[seen]
    azimuths = r.uniform(-0.6, 0.6) + np.linspace(-0.55, 0.55, n) * (n > 1)
    for k in range(n):
        distance = size * r.uniform(1.0, 1.6)
        elevation = r.uniform(0.1, 0.6)
        if category == "box":
            elevation += 0.35
        out = np.array([math.sin(azimuths[k]) * math.cos(elevation), -math.cos(azimuths[k]) * math.cos(elevation), math.sin(elevation)])
        eye_F = middle + out * distance
        eye, at = R_WF @ eye_F + p_WF, R_WF @ middle + p_WF
        width, height = 480, 360
        focal = 0.42 * height * distance / size
        X = (looking(eye, at), eye, focal, width, height)
        points, label = view(r, parts, R_WF, p_WF, X, (width, height), around, quality)
        if seen != "camera frame":
            points = points @ X[0].T + eye
        clouds.append(points), labels.append(label)
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = X[0], eye
        views.append({"X_WC": pose.tolist(), "width": width, "height": height, "fx": focal, "fy": focal, "cx": width / 2, "cy": height / 2})
    if seen == "three views":
        clouds, labels = [np.concatenate(clouds)], [np.concatenate(labels)]
        kept = thinned(r, labels[0], int(r.choice([8000, 20000, 60000])))
        clouds, labels = [clouds[0][kept]], [labels[0][kept]]
    if seen != "three views":
        most = int(r.choice([4000, 10000, 30000]))
        for k in range(len(clouds)):
            kept = np.sort(thinned(r, labels[k], most))
            clouds[k], labels[k] = clouds[k][kept], labels[k][kept]
    for k, cloud in enumerate(clouds):
        write_ply(folder / f"view_{k}.ply", cloud)
    if seen == "camera frame":
        (folder / "poses.json").write_text(json.dumps({"views": views, "frame": "camera"}))
    joints = []
    for part in parts[1:]:
        joints.append({"class": part.kind, "type": part.type, "axis": (R_WF @ np.array(part.axis, float)).tolist(),
                       "origin": (R_WF @ np.array(part.origin, float) + p_WF).tolist(), "lower": part.lower, "upper": part.upper, "q": part.q})
    truth = {"category": category, "state": state, "seen": seen, "where": where, "joints": joints, "points": sum(len(c) for c in clouds)}
    (root / "sealed").mkdir(exist_ok=True)
    (root / "sealed" / f"{name}.json").write_text(json.dumps(truth))
    np.save(root / "sealed" / f"{name}.npy", np.concatenate(labels).astype(np.int16))
    return name


# ---- judging --------------------------------------------------------------------------------------------------------------------------


def ask(program, root, name):
    folder = root / name
    command = [program, "perceive", *[str(p) for p in sorted(folder.glob("view_*.ply"))], "--out", str(root / "answers" / name), "--format", "json"]
    if (folder / "poses.json").exists():
        command += ["--camera-pose", str(folder / "poses.json")]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        return None, done.stderr.strip()
    return json.loads(done.stdout), None


def read_parts(path):
    """The `part` of each point of an ASCII or binary PLY."""
    data = path.read_bytes()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    header = data[:end].decode()
    names, kinds, count = [], [], 0
    for line in header.splitlines():
        words = line.split()
        if words[0] == "element" and words[1] == "vertex":
            count = int(words[2])
        if words[0] == "property":
            names.append(words[-1])
            kinds.append({"float": "<f4", "double": "<f8", "int": "<i4", "uchar": "u1", "float32": "<f4", "int32": "<i4", "float64": "<f8"}[words[1]])
    if "ascii" in header:
        rows = [line.split() for line in data[end:].decode().splitlines()]
        return np.array([int(row[names.index("part")]) for row in rows])
    return np.frombuffer(data[end:], dtype=list(zip(names, kinds)), count=count)["part"].astype(int)


def judge(root, name, answer):
    truth = json.loads((root / "sealed" / f"{name}.json").read_text())
    label = np.load(root / "sealed" / f"{name}.npy").astype(int)
    part = read_parts(root / "answers" / name / "parts.ply")
    assert len(part) == len(label), (len(part), len(label))
    ids = [p["id"] for p in answer["parts"]]
    link = {p["id"]: p["link"] for p in answer["parts"]}
    joint = {j["child"]: j for j in answer["joints"]}
    rows, used, ious = [], set(), []
    total = (label >= 0).sum()
    for index in range(len(truth["joints"]) + 1):
        mask = label == index
        if mask.sum() < max(20, 0.003 * total):
            continue
        overlaps = [((part == i) & mask).sum() / max(1, ((part == i) | mask).sum()) for i in ids]
        best = int(np.argmax(overlaps)) if overlaps else -1
        iou = overlaps[best] if best >= 0 else 0.0
        ious.append(iou)
        if iou >= 0.5:
            used.add(ids[best])
        if index == 0:
            continue
        true = truth["joints"][index - 1]
        row = {"class": true["class"], "iou": round(float(iou), 2), "found": bool(iou >= 0.5), "good": False}
        said = joint.get(link[ids[best]]) if iou >= 0.5 else None
        if said:
            row["type"] = said["type"] == true["type"]
            a, b, at = np.array(true["axis"]), np.array(said["axis"]), np.array(said["origin"])
            if answer["frame"] == "camera":
                X_WC = np.array(json.loads((root / name / "poses.json").read_text())["views"][0]["X_WC"])
                b, at = X_WC[:3, :3] @ b, X_WC[:3, :3] @ at + X_WC[:3, 3]
            angle = math.degrees(math.acos(min(1.0, abs(float(a @ b)))))
            row["axis"] = round(angle, 1)
            row["sense"] = float(a @ b) > 0
            place = 0.0
            if true["type"] == "revolute":
                v = np.array(true["origin"]) - at
                place = float(np.linalg.norm(v - b * (v @ b)))
                row["place"] = round(100 * place, 1)
            row["good"] = bool(row["type"] and angle < 5 and place < 0.05)
        elif iou >= 0.5:
            row["type"] = False
        rows.append(row)
    false = sum(1 for j in answer["joints"] if next((p["id"] for p in answer["parts"] if p["link"] == j["child"]), None) not in used)
    return truth, rows, float(np.mean(ious)), false


def say(title, rows):
    good = sum(row["good"] for _, row in rows)
    print(f"{title:16} {good:4}/{len(rows):<4} {good / max(1, len(rows)):.2f}")


def main():
    reads = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    reads.add_argument("out", type=pathlib.Path)
    reads.add_argument("--count", type=int, default=60)
    reads.add_argument("--seed", type=int, default=1)
    reads.add_argument("--sagci")
    asked = reads.parse_args()
    all_rows, all_iou, all_false, times, refused = [], [], 0, [], 0
    for number in range(asked.count):
        name = make(asked.seed, number, asked.out)
        if not asked.sagci:
            continue
        answer, wrong = ask(asked.sagci, asked.out, name)
        truth = json.loads((asked.out / "sealed" / f"{name}.json").read_text())
        head = f"{name} {truth['category']:12} {truth['state']:5} {truth['seen']:12} {truth['points']:6} {truth['where']:7}"
        if answer is None:
            refused += 1
            print(head, "REFUSED", wrong, flush=True)
            all_iou.append(0.0)
            all_rows += [(truth, {"good": False, "found": False}) for _ in truth["joints"]]
            continue
        truth, rows, iou, false = judge(asked.out, name, answer)
        times.append(answer["seconds"]["total"])
        all_iou.append(iou)
        all_false += false
        all_rows += [(truth, row) for row in rows]
        bad = [row for row in rows if not row["good"]]
        print(head, f"iou {iou:.2f} good {len(rows) - len(bad)}/{len(rows)} false {false} {times[-1]:.2f} s", *[f"\n      {b}" for b in bad], flush=True)
    if not asked.sagci:
        return
    for key in ("category", "state", "seen", "where"):
        for value in sorted({t[key] for t, _ in all_rows}):
            say(value, [(t, row) for t, row in all_rows if t[key] == value])
    say("all", all_rows)
    angles = [row["axis"] for _, row in all_rows if "axis" in row]
    places = [row["place"] for _, row in all_rows if "place" in row]
    found = np.mean([row["found"] for _, row in all_rows])
    print(f"mIoU {np.mean(all_iou):.3f}  found {found:.2f}  axis {np.mean(angles):.2f}  place {np.mean(places):.2f} ({np.median(places):.2f}) cm")
    print(f"false {all_false / asked.count:.2f} a cloud  refused {refused}  slowest {max(times):.2f} s")


if __name__ == "__main__":
    main()
