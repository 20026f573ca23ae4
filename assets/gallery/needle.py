"""Writes needle.obj, a cone of 12 degrees with a rounded tip of 1 mm radius, 30 mm long: python3 needle.py"""
from math import cos, pi, radians, sin, tan

TIP, SLOPE, LENGTH, AROUND = 0.001, 12, 0.03, 24

# The profile from the tip up: distance from the axis and height, m.
profile = [(TIP * sin(radians(a)), TIP - TIP * cos(radians(a))) for a in (20, 40, 60, 90 - SLOPE)]
r, y = profile[-1]
profile.append((r + (LENGTH - y) * tan(radians(SLOPE)), LENGTH))
rows = len(profile)
with open("needle.obj", "w") as out:
    out.write("# A needle, its tip at the origin, y along its axis, m; written by needle.py.\n")
    for r, y in profile:
        for k in range(AROUND):
            out.write(f"v {r * cos(2 * pi * k / AROUND):.6f} {y:.6f} {r * sin(2 * pi * k / AROUND):.6f}\n")
    out.write(f"v 0 0 0\nv 0 {LENGTH} 0\n")
    at = lambda row, k: row * AROUND + k % AROUND + 1
    low, high = rows * AROUND + 1, rows * AROUND + 2
    for k in range(AROUND):
        out.write(f"f {low} {at(0, k)} {at(0, k + 1)}\nf {high} {at(rows - 1, k + 1)} {at(rows - 1, k)}\n")
        for row in range(rows - 1):
            a, b, c, d = at(row, k), at(row, k + 1), at(row + 1, k + 1), at(row + 1, k)
            out.write(f"f {a} {c} {b}\nf {a} {d} {c}\n")
