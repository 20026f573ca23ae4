"""Writes punch.obj, a cylinder of 12 mm radius and 20 mm height with edges rounded by 2 mm: python3 punch.py"""
from math import cos, pi, sin

from lathe import write

RADIUS, HALF, EDGE, AROUND, ROUNDED = 0.012, 0.010, 0.002, 48, 4

# The profile from the lower end to the upper: distance from the axis and height, m.
profile = [(0.003 * k, -HALF) for k in (1, 2)]
angles = [0.5 * pi * k / ROUNDED for k in range(ROUNDED + 1)]
arc = [(RADIUS - EDGE + EDGE * sin(a), HALF - EDGE + EDGE * cos(a)) for a in angles]
profile += [(r, -y) for r, y in arc]
profile += [(RADIUS, -0.004), (RADIUS, 0.0), (RADIUS, 0.004)]
profile += [(r, y) for r, y in reversed(arc)] + [(0.003 * k, HALF) for k in (2, 1)]
write("punch.obj", "A cylinder with rounded edges, y along its axis, m; written by punch.py.", profile, (-HALF, HALF), AROUND)
