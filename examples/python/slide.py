"""Slides a fingertip over a slab with a stiff lump inside, and over the same slab without it: python slide.py [FILE.csv]

Prints where the force rises most above that of the plain slab, and writes position and both forces into a file if one is
named."""

import sys

import numpy as np
import palpate


def felt(scene: palpate.Scene) -> tuple[palpate.Floats, palpate.Floats]:
    """Position along x (m) and force upwards (N) at each step of the slide."""
    simulation = palpate.Simulation(scene)
    trace = simulation.run(progress=True)
    print(f"{len(trace)} steps, flags {trace.flagged()}, {len(simulation.contacts().depth)} contacts at the end")
    slides = trace.time > 0.2  # before, the tip comes down
    return trace.tool[slides, 0], trace.force[slides, 1]


def main() -> None:
    """Slide twice, and compare."""
    scene = palpate.Scene.load("lump")
    (slab,) = scene.tables["body"]
    plain = {key: value for key, value in slab.items() if key != "region"}
    x, with_lump = felt(scene)
    _, without = felt(palpate.Scene({**scene.tables, "body": [plain]}))
    at = int(np.argmax(with_lump - without))
    print(f"most at x = {1e3 * x[at]:.1f} mm: {with_lump[at]:.2f} N with the lump, {without[at]:.2f} N without")
    if len(sys.argv) > 1:
        rows = np.column_stack([x, with_lump, without])
        np.savetxt(sys.argv[1], rows, delimiter=",", header="x (m),with lump (N),without (N)", comments="")


if __name__ == "__main__":
    main()
