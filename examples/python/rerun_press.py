"""Shows a running press in rerun: python rerun_press.py [FILE.rrd]

Streams the head, the fingertip, the contact forces as arrows and the net force as a curve to rerun's viewer, which it opens,
or into a file if one is named. Needs the package rerun-sdk."""

# pyright: basic

import sys

import numpy as np
import palpate
import rerun as rr  # pyright: ignore[reportMissingImports]

METRES_PER_NEWTON = 0.5


def show(simulation: palpate.Simulation, body: str, colour: tuple[int, int, int]) -> None:
    """Log the skin of a body as it is now."""
    skin = simulation.skin(body)
    mesh = rr.Mesh3D(
        vertex_positions=skin.positions,
        vertex_normals=skin.normals,
        triangle_indices=simulation.triangles(body),
        albedo_factor=colour,
    )
    rr.log(f"world/{body}", mesh)


def main() -> None:
    """Press, and log as time goes on."""
    rr.init("palpate", spawn=len(sys.argv) == 1)
    if len(sys.argv) > 1:
        rr.save(sys.argv[1])
    rr.log("world", rr.ViewCoordinates.RIGHT_HAND_Y_UP, static=True)
    simulation = palpate.Simulation("touch-head")
    for step in range(400):
        report = simulation.step()
        rr.set_time("simulated", duration=report.time)
        if report.force is not None:
            rr.log("force", rr.Scalars(np.linalg.norm(report.force)))
        if step % 20 == 0:
            show(simulation, "head", (225, 180, 160))
            show(simulation, "tool", (120, 130, 140))
            contacts = simulation.contacts()
            arrows = rr.Arrows3D(origins=contacts.position, vectors=METRES_PER_NEWTON * contacts.force)
            rr.log("world/contact_forces", arrows)


if __name__ == "__main__":
    main()
