"""Writes forearm.msh, a tapering limb along x in mm, in groups skin, fat and muscle: python3 forearm.py"""
from math import cos, pi, sin

AROUND, ALONG, LENGTH = 16, 13, 200.0
# Radii of the rings of nodes around the axis, as shares of the limb's radius. GROUPS names the group of the tetrahedra
# between each ring and the ring inside it (the axis, for the first ring).
RINGS = [0.4, 0.76, 0.91, 1.0]
GROUPS = ["muscle", "muscle", "fat", "skin"]
NUMBERS = {"skin": 1, "fat": 2, "muscle": 3}

nodes, tetrahedra = [], []
for slab in range(ALONG + 1):
    x = LENGTH * slab / ALONG
    height, width = 36.0 - 14.0 * slab / ALONG, 42.0 - 14.0 * slab / ALONG
    nodes.append((x, 0.0, 0.0))
    for share in RINGS:
        for k in range(AROUND):
            angle = 2.0 * pi * k / AROUND
            nodes.append((x, share * height * sin(angle), share * width * cos(angle)))


def node(slab, ring, k):
    first = slab * (1 + AROUND * len(RINGS)) + 1
    return first if ring == 0 else first + 1 + (ring - 1) * AROUND + k % AROUND


def prism(triangle, slab, group):
    """Adds a prism as three tetrahedra. So that neighbouring prisms fit together, the diagonal that splits each
    quadrilateral side face starts at the corner of this face with the least node number."""
    low = sorted(triangle, key=lambda corner: node(0, *corner))
    a, b, c = (node(slab, *corner) for corner in low)
    d, e, f = (node(slab + 1, *corner) for corner in low)
    for corners in ((a, b, c, f), (a, b, e, f), (a, d, e, f)):
        p, q, r, s = (nodes[n - 1] for n in corners)
        u, v, w = ([t[i] - p[i] for i in range(3)] for t in (q, r, s))
        volume = sum(u[i] * (v[i - 2] * w[i - 1] - v[i - 1] * w[i - 2]) for i in range(3))
        assert abs(volume) > 1e-6
        tetrahedra.append((NUMBERS[group], corners if volume > 0 else (corners[0], corners[1], corners[3], corners[2])))


for slab in range(ALONG):
    for ring, group in enumerate(GROUPS):
        for k in range(AROUND):
            inner, outer = (ring, k), (ring + 1, k)
            inner_next, outer_next = (ring, k + 1 if k + 1 < AROUND else 0), (ring + 1, k + 1 if k + 1 < AROUND else 0)
            if ring == 0:
                prism([(0, 0), outer, outer_next], slab, group)
            else:
                prism([inner, outer, outer_next], slab, group)
                prism([inner, outer_next, inner_next], slab, group)

with open("forearm.msh", "w") as out:
    out.write("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n3\n")
    for name, number in NUMBERS.items():
        out.write(f'3 {number} "{name}"\n')
    out.write(f"$EndPhysicalNames\n$Nodes\n{len(nodes)}\n")
    for n, (x, y, z) in enumerate(nodes, 1):
        out.write(f"{n} {x:.1f} {y:.1f} {z:.1f}\n")
    out.write(f"$EndNodes\n$Elements\n{len(tetrahedra)}\n")
    for n, (group, corners) in enumerate(tetrahedra, 1):
        out.write(f"{n} 4 1 {group} {' '.join(map(str, corners))}\n")
    out.write("$EndElements\n")
