"""Momentum of bodies between two states of one run: python3 momentum.py EARLY LATE SECONDS DENSITY NAME..

EARLY and LATE are the folders of two runs of the same scene that end SECONDS apart. In them NAME.vtk is the layer (the
deformed tetrahedral mesh) of the soft body NAME. DENSITY is that of all these bodies, kg/m^3."""

import sys

import numpy as np


def centre_of_mass(file):
    """Volume (m^3) at rest and centre of mass (m) of a deformed layer of one density."""
    words = open(file).read().split()

    def rows(key, skip, count, width):
        first = words.index(key) + skip
        return np.array(words[first:first + width * count], float).reshape(count, width)

    size = lambda key: int(words[words.index(key) + 1])
    nodes = rows("POINTS", 3, size("POINTS"), 3)
    rest = nodes - rows("displacement", 2, size("POINTS"), 3)
    corners = rows("CELLS", 3, size("CELLS"), 5)[:, 1:].astype(int)
    a, b, c, d = rest[corners].transpose(1, 0, 2)
    volumes = np.abs(np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a)) / 6
    return volumes.sum(), volumes @ nodes[corners].mean(axis=1) / volumes.sum()


def main(early, late, seconds, density, *names):
    total = np.zeros(3)
    for name in names:
        (volume, before), (_, after) = (centre_of_mass(f"{folder}/{name}.vtk") for folder in (early, late))
        momentum = 1e3 * float(density) * volume * (after - before) / float(seconds)
        total += momentum
        print(f"{name:6s} {1e3 * float(density) * volume:.3f} g  ({', '.join(f'{p:+.6f}' for p in momentum)}) mN s")
    print(f"together        ({', '.join(f'{p:+.6f}' for p in total)}) mN s")


if __name__ == "__main__":
    main(*sys.argv[1:])
