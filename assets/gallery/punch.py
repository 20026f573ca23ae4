"""Writes punch.obj, a cylinder of 12 mm radius and 20 mm height with edges rounded by 2 mm: python3 punch.py"""
from math import cos, pi, sin

RADIUS, HALF, EDGE, AROUND, ROUNDED = 0.012, 0.010, 0.002, 48, 4

# The profile from the lower end to the upper: distance from the axis and height, m.
profile = [(0.003 * k, -HALF) for k in (1, 2)]
angles = [0.5 * pi * k / ROUNDED for k in range(ROUNDED + 1)]
arc = [(RADIUS - EDGE + EDGE * sin(a), HALF - EDGE + EDGE * cos(a)) for a in angles]
profile += [(r, -y) for r, y in arc]
profile += [(RADIUS, -0.004), (RADIUS, 0.0), (RADIUS, 0.004)]
profile += [(r, y) for r, y in reversed(arc)] + [(0.003 * k, HALF) for k in (2, 1)]
rows = len(profile)
with open("punch.obj", "w") as out:
    out.write("# A cylinder with rounded edges, y along its axis, m; written by punch.py.\n")
    for r, y in profile:
        for k in range(AROUND):
            out.write(f"v {r * cos(2 * pi * k / AROUND):.6f} {y:.6f} {r * sin(2 * pi * k / AROUND):.6f}\n")
    out.write(f"v 0 {-HALF} 0\nv 0 {HALF} 0\n")
    at = lambda row, k: row * AROUND + k % AROUND + 1
    low, high = rows * AROUND + 1, rows * AROUND + 2
    for k in range(AROUND):
        out.write(f"f {low} {at(0, k)} {at(0, k + 1)}\nf {high} {at(rows - 1, k + 1)} {at(rows - 1, k)}\n")
        for row in range(rows - 1):
            a, b, c, d = at(row, k), at(row, k + 1), at(row + 1, k + 1), at(row + 1, k)
            out.write(f"f {a} {c} {b}\nf {a} {d} {c}\n")
