"""Runs a scene, then reads the deformed skin (surface mesh) of its first body: python3 watch.py SCENE STEPS

The library writes into arrays that NumPy owns. The array `force` shares the memory of `wrench`, so it changes at each
step."""

import ctypes
import sys
from ctypes import POINTER, byref, c_int32, c_size_t, c_uint32, c_void_p

import numpy as np
from touch import Wrench, kept, library


def skin(palpate, simulation, body, positions=None, normals=None):
    """Writes positions (m) and normals of a body's skin into the arrays given (float32, a row of three numbers for each
    vertex); returns the skin's number of vertices."""
    pointer = lambda array: None if array is None else array.ctypes.data_as(c_void_p)
    count = c_size_t()
    capacity = 0 if positions is None else len(positions)
    palpate.palpate_skin(simulation, body, None, pointer(positions), pointer(normals), capacity, byref(count))
    return count.value


def main(scene_file, steps, path="libpalpate.so"):
    palpate = library(path)
    function = palpate.palpate_skin
    function.argtypes = [c_void_p, c_uint32, c_void_p, c_void_p, c_void_p, c_size_t, POINTER(c_size_t)]
    function.restype, function.errcheck = c_int32, palpate.palpate_step.errcheck
    context, scene, simulation = c_void_p(), c_void_p(), c_void_p()
    palpate.palpate_context_create(byref(kept()), byref(context))
    palpate.palpate_scene_load(scene_file.encode(), byref(scene))
    palpate.palpate_simulation_create(context, scene, byref(simulation))
    palpate.palpate_scene_destroy(scene)

    rest = np.empty((skin(palpate, simulation, 0), 3), np.float32)
    skin(palpate, simulation, 0, rest)
    now, normals = np.empty_like(rest), np.empty_like(rest)
    wrench = Wrench(size=ctypes.sizeof(Wrench))
    force = np.ctypeslib.as_array(wrench.force)
    for _ in range(int(steps)):
        palpate.palpate_step(simulation, None, byref(wrench))
    skin(palpate, simulation, 0, now, normals)
    inward = -np.einsum("ij,ij->i", now - rest, normals)
    deepest = inward.argmax()
    print(f"{np.linalg.norm(force):.6f} N; of {len(rest)} vertices {(inward > 1e-4).sum()} are pressed in by more than 0.1 mm,")
    print(f"vertex {deepest} the deepest, by {1e3 * inward[deepest]:.3f} mm")
    palpate.palpate_simulation_destroy(simulation)
    palpate.palpate_context_destroy(context)


if __name__ == "__main__":
    main(*sys.argv[1:])
