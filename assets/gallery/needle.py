"""Writes needle.obj, a cone of 12 degrees with a rounded tip of 1 mm radius, 30 mm long: python3 needle.py"""
from math import cos, pi, radians, sin, tan

from lathe import write

TIP, SLOPE, LENGTH, AROUND = 0.001, 12, 0.03, 24

# The profile from the tip up: distance from the axis and height, m.
profile = [(TIP * sin(radians(a)), TIP - TIP * cos(radians(a))) for a in (20, 40, 60, 90 - SLOPE)]
r, y = profile[-1]
profile.append((r + (LENGTH - y) * tan(radians(SLOPE)), LENGTH))
write("needle.obj", "A needle, its tip at the origin, y along its axis, m; written by needle.py.", profile, (0, LENGTH), AROUND)
