"""Writes bodies of revolution about y for the scenes of the gallery; called by punch.py and needle.py."""
from math import cos, pi, sin


def write(name, what, profile, ends, around):
    """Writes an OBJ file: `profile` gives distance from the axis and height (m) of each ring of vertices, from the lowest
    up; `ends` the heights of the two ends on the axis, `around` the number of vertices of a ring."""
    rows = len(profile)
    with open(name, "w") as out:
        out.write(f"# {what}\n")
        for r, y in profile:
            for k in range(around):
                out.write(f"v {r * cos(2 * pi * k / around):.6f} {y:.6f} {r * sin(2 * pi * k / around):.6f}\n")
        out.write(f"v 0 {ends[0]} 0\nv 0 {ends[1]} 0\n")
        at = lambda row, k: row * around + k % around + 1
        low, high = rows * around + 1, rows * around + 2
        for k in range(around):
            out.write(f"f {low} {at(0, k)} {at(0, k + 1)}\nf {high} {at(rows - 1, k + 1)} {at(rows - 1, k)}\n")
            for row in range(rows - 1):
                a, b, c, d = at(row, k), at(row, k + 1), at(row + 1, k + 1), at(row + 1, k)
                out.write(f"f {a} {c} {b}\nf {a} {d} {c}\n")
