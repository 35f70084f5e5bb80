"""What the converters share: meshes, mass properties, URDF text, and the version's name.

Python's standard library only. Lengths in m, masses in kg, angles in rad. Rotations are 3x3 nested tuples, row major.
"""

import hashlib
import math
import os
import shutil
import struct
import xml.sax.saxutils


# ---------------------------------------------------------------- vectors and rotations

def add(a, b):
    return tuple(x + y for x, y in zip(a, b))


def sub(a, b):
    return tuple(x - y for x, y in zip(a, b))


def mul(a, s):
    return tuple(x * s for x in a)


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def norm(a):
    return math.sqrt(dot(a, a))


def unit(a):
    return mul(a, 1 / norm(a))


IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def matmul(A, B):
    return tuple(tuple(sum(A[i][k] * B[k][j] for k in range(3)) for j in range(3)) for i in range(3))


def matvec(A, v):
    return tuple(dot(row, v) for row in A)


def transpose(A):
    return tuple(zip(*A))


def rotation_of(rpy):
    """URDF's convention: about the fixed axes x, y, z in turn."""
    (cr, cp, cy), (sr, sp, sy) = [tuple(map(f, rpy)) for f in (math.cos, math.sin)]
    return (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )


def rpy_of(R):
    """Inverse of `rotation_of`; at the singularity the yaw is zero."""
    if math.hypot(R[0][0], R[1][0]) < 1e-9:
        return (math.atan2(-R[1][2] * math.copysign(1, -R[2][0]), R[1][1]), math.atan2(-R[2][0], 0.0), 0.0)
    return (math.atan2(R[2][1], R[2][2]), math.atan2(-R[2][0], math.hypot(R[0][0], R[1][0])), math.atan2(R[1][0], R[0][0]))


def rotation_taking_z_to(axis):
    """The least rotation that takes z to a direction."""
    z = unit(axis)
    v, c = cross((0, 0, 1), z), z[2]
    if c < -1 + 1e-12:
        return rotation_of((math.pi, 0, 0))
    K = ((0, -v[2], v[1]), (v[2], 0, -v[0]), (-v[1], v[0], 0))
    K2 = matmul(K, K)
    return tuple(tuple(IDENTITY[i][j] + K[i][j] + K2[i][j] / (1 + c) for j in range(3)) for i in range(3))


# ---------------------------------------------------------------- meshes

def read_stl(path):
    """Triangles of a binary STL."""
    data = open(path, "rb").read()
    count = struct.unpack_from("<I", data, 80)[0]
    triangles = []
    for i in range(count):
        r = struct.unpack_from("<12f", data, 84 + 50 * i)
        triangles.append((r[3:6], r[6:9], r[9:12]))
    return triangles


def write_stl(path, triangles):
    """Binary STL with the normals computed anew; triangles without area are left out."""
    body = b""
    count = 0
    for a, b, c in triangles:
        n = cross(sub(b, a), sub(c, a))
        if norm(n) < 1e-12:
            continue
        body += struct.pack("<12fH", *unit(n), *a, *b, *c, 0)
        count += 1
    with open(path, "wb") as f:
        f.write(b"binary STL, metres".ljust(80, b" ") + struct.pack("<I", count) + body)


def transform(triangles, R=IDENTITY, p=(0, 0, 0), scale=1.0):
    return [tuple(add(matvec(R, mul(v, scale)), p) for v in t) for t in triangles]


# ---------------------------------------------------------------- solids and their mass properties
#
# A solid is (kind, dimensions, position, rpy); dimensions as URDF writes them.

def box(size, xyz=(0, 0, 0), rpy=(0, 0, 0), name=None):
    return dict(kind="box", size=size, xyz=xyz, rpy=rpy, name=name)


def sphere(radius, xyz=(0, 0, 0), name=None):
    return dict(kind="sphere", radius=radius, xyz=xyz, rpy=(0, 0, 0), name=name)


def cylinder(radius, length, xyz=(0, 0, 0), rpy=(0, 0, 0), name=None):
    return dict(kind="cylinder", radius=radius, length=length, xyz=xyz, rpy=rpy, name=name)


def capsule(radius, length, xyz=(0, 0, 0), rpy=(0, 0, 0), name=None):
    """`length` is that of the straight part."""
    return dict(kind="capsule", radius=radius, length=length, xyz=xyz, rpy=rpy, name=name)


def capsule_between(a, b, radius, name=None):
    d = sub(b, a)
    rpy = (0, 0, 0) if norm(d) < 1e-9 else rpy_of(rotation_taking_z_to(d))
    return capsule(radius, norm(d), mul(add(a, b), 0.5), rpy, name)


def mesh(filename, xyz=(0, 0, 0), rpy=(0, 0, 0), name=None, scale=None):
    return dict(kind="mesh", filename=filename, xyz=xyz, rpy=rpy, name=name, scale=scale)


def volume(s):
    if s["kind"] == "box":
        return s["size"][0] * s["size"][1] * s["size"][2]
    if s["kind"] == "sphere":
        return 4 / 3 * math.pi * s["radius"] ** 3
    if s["kind"] == "cylinder":
        return math.pi * s["radius"] ** 2 * s["length"]
    return math.pi * s["radius"] ** 2 * (s["length"] + 4 / 3 * s["radius"])


def unit_inertia(s):
    """Inertia about the solid's centre, in its own axes, for a mass of one (diagonal)."""
    if s["kind"] == "box":
        x, y, z = (d * d for d in s["size"])
        return ((y + z) / 12, (x + z) / 12, (x + y) / 12)
    r = s["radius"]
    if s["kind"] == "sphere":
        return (0.4 * r * r,) * 3
    h = s["length"]
    if s["kind"] == "cylinder":
        across = r * r / 4 + h * h / 12
        return (across, across, r * r / 2)
    # A capsule: a cylinder of length h, and two half spheres whose centres of mass lie 3 r / 8 beyond its ends.
    total = h + 4 / 3 * r
    mc, ms = h / total, 4 / 3 * r / total
    across = mc * (r * r / 4 + h * h / 12) + ms * (0.4 * r * r + h * h / 4 + 3 / 8 * r * h)
    return (across, across, mc * r * r / 2 + ms * 0.4 * r * r)


def mass_properties(parts):
    """(mass, centre of mass, inertia about it in the frame's axes) of [(solid, mass)]."""
    mass = sum(m for _, m in parts)
    com = mul(tuple(sum(m * s["xyz"][k] for s, m in parts) for k in range(3)), 1 / mass)
    I = [[0.0] * 3 for _ in range(3)]
    for s, m in parts:
        R = rotation_of(s["rpy"])
        d = unit_inertia(s)
        p = sub(s["xyz"], com)
        for i in range(3):
            for j in range(3):
                I[i][j] += m * sum(R[i][k] * d[k] * R[j][k] for k in range(3))
                I[i][j] += m * ((dot(p, p) if i == j else 0) - p[i] * p[j])
    return mass, com, I


# ---------------------------------------------------------------- URDF text

def number(x, digits=9):
    x = round(x, digits)
    return repr(int(x)) if x == int(x) else repr(x)


def vector(v, digits=9):
    return " ".join(number(x, digits) for x in v)


def pose_element(xyz, rpy):
    if not any(abs(x) > 1e-12 for x in (*xyz, *rpy)):
        return ""
    return f'<origin xyz="{vector(xyz)}" rpy="{vector(rpy, 12)}"/>'


def shape_element(tag, s, rgba=None):
    name = f' name="{s["name"]}"' if s.get("name") else ""
    if s["kind"] == "box":
        g = f'<box size="{vector(s["size"])}"/>'
    elif s["kind"] == "sphere":
        g = f'<sphere radius="{number(s["radius"])}"/>'
    elif s["kind"] == "mesh":
        scale = f' scale="{vector((s["scale"],) * 3)}"' if s["scale"] else ""
        g = f'<mesh filename="{xml.sax.saxutils.escape(s["filename"])}"{scale}/>'
    else:
        g = f'<{s["kind"]} radius="{number(s["radius"])}" length="{number(s["length"])}"/>'
    material = f'<material name="{colour_name(rgba)}"><color rgba="{vector(rgba)}"/></material>' if rgba else ""
    return f'    <{tag}{name}>{pose_element(s["xyz"], s["rpy"])}<geometry>{g}</geometry>{material}</{tag}>'


def colour_name(rgba):
    return "rgba_" + "_".join(number(round(x, 3)).replace(".", "p") for x in rgba)


def link_element(name, inertial=None, visuals=(), collisions=()):
    """`inertial` is (mass, centre of mass, inertia); `visuals` are (solid, rgba)."""
    lines = [f'  <link name="{name}">']
    if inertial:
        m, com, I = inertial
        n = lambda i, j: number(I[i][j], 14)
        lines += [
            "    <inertial>",
            f'      <origin xyz="{vector(com)}" rpy="0 0 0"/>',
            f'      <mass value="{number(m)}"/>',
            f'      <inertia ixx="{n(0, 0)}" ixy="{n(0, 1)}" ixz="{n(0, 2)}" iyy="{n(1, 1)}" iyz="{n(1, 2)}" izz="{n(2, 2)}"/>',
            "    </inertial>",
        ]
    lines += [shape_element("visual", s, rgba) for s, rgba in visuals]
    lines += [shape_element("collision", s) for s in collisions]
    return "\n".join(lines + ["  </link>"]) if len(lines) > 1 else f'  <link name="{name}"/>'


def joint_element(name, kind, parent, child, xyz=(0, 0, 0), rpy=(0, 0, 0), axis=None, limit=None, dynamics=None):
    """`limit` is (lower, upper, velocity, effort); `dynamics` is (damping, friction)."""
    lines = [f'  <joint name="{name}" type="{kind}">', f'    <parent link="{parent}"/>', f'    <child link="{child}"/>']
    lines.append(f'    <origin xyz="{vector(xyz)}" rpy="{vector(rpy, 15)}"/>')
    if axis:
        lines.append(f'    <axis xyz="{vector(axis)}"/>')
    if limit:
        lo, hi, v, e = map(number, limit)
        lines.append(f'    <limit lower="{lo}" upper="{hi}" velocity="{v}" effort="{e}"/>')
    if dynamics:
        lines.append(f'    <dynamics damping="{number(dynamics[0])}" friction="{number(dynamics[1])}"/>')
    return "\n".join(lines + ["  </joint>"])


def robot_element(name, parts, comment):
    # URDF 1.1 is the version that has capsules.
    head = f'<?xml version="1.0" encoding="utf-8"?>\n<!-- {comment} -->\n<robot name="{name}" version="1.1">\n'
    return head + "\n".join(parts) + "\n</robot>\n"


# ---------------------------------------------------------------- versions

def version_of(folder):
    """The name of a version: the first 12 hex digits of the SHA-256 of its list of files.

    The list has one line a file, `<SHA-256 of the file's bytes>  <path>\\n`, sorted by the bytes of the path; so
    `find . -type f -printf '%P\\n' | LC_ALL=C sort | xargs sha256sum | sha256sum` gives the same.
    """
    lines = []
    for root, _, files in os.walk(folder):
        for f in files:
            path = os.path.relpath(os.path.join(root, f), folder).replace(os.sep, "/")
            with open(os.path.join(root, f), "rb") as handle:
                lines.append((path.encode(), hashlib.sha256(handle.read()).hexdigest()))
    text = b"".join(digest.encode() + b"  " + path + b"\n" for path, digest in sorted(lines))
    return hashlib.sha256(text).hexdigest()[:12]


def publish(library, name, staged):
    """Moves a staged folder to its place under the name of its content, and points HEAD at it."""
    version = version_of(staged)
    home = os.path.join(library, name)
    os.makedirs(home, exist_ok=True)
    target = os.path.join(home, version)
    if os.path.exists(target):
        shutil.rmtree(staged)
    else:
        os.rename(staged, target)
    temporary = os.path.join(home, ".HEAD.new")
    with open(temporary, "w") as f:
        f.write(version + "\n")
    os.replace(temporary, os.path.join(home, "HEAD"))
    return version
