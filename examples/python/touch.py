"""Runs a scene and prints for each step its number, the force on the tool (x, y, z; N) and the step's warning flags.
The tool is the rigid body that the haptic device leads. Needs only Python and palpate: python3 touch.py SCENE STEPS"""

import ctypes
import sys
from ctypes import POINTER, byref, c_char_p, c_double, c_int32, c_size_t, c_uint32, c_uint64, c_void_p


class Pose(ctypes.Structure):
    _fields_ = [("position", c_double * 3), ("orientation", c_double * 4)]


class Wrench(ctypes.Structure):
    _fields_ = [
        ("size", c_uint32),
        ("flags", c_uint32),
        ("step", c_uint64),
        ("time", c_double),
        ("force", c_double * 3),
        ("torque", c_double * 3),
        ("tool", Pose),
        ("device", Pose),
        ("max_depth", c_double),
        ("residual", c_double),
        ("contacts", c_uint32),
        ("iterations", c_uint32),
    ]


class ContextOptions(ctypes.Structure):
    _fields_ = [
        ("size", c_uint32),
        ("validation", c_uint32),
        ("device", c_char_p),
        ("log", c_void_p),
        ("log_user", c_void_p),
        ("cache", c_char_p),
        ("measure", c_uint32),
        ("threads", c_int32),
    ]


def kept():
    """Options of a context that keeps prepared bodies and measurements of the device in the user's cache folder."""
    return ContextOptions(size=ctypes.sizeof(ContextOptions), cache=b"", measure=1)


def library(path="libpalpate.so"):
    palpate = ctypes.CDLL(path)
    palpate.palpate_last_error.restype = c_char_p
    palpate.palpate_version.restype = c_char_p
    palpate.palpate_abi.restype = c_uint32

    def checked(status, function, _):
        if status != 0:
            raise RuntimeError(f"{function.__name__}: {palpate.palpate_last_error().decode()}")

    for name, arguments in {
        "palpate_context_create": [c_void_p, POINTER(c_void_p)],
        "palpate_context_destroy": [c_void_p],
        "palpate_scene_load": [c_char_p, POINTER(c_void_p)],
        "palpate_scene_destroy": [c_void_p],
        "palpate_simulation_create": [c_void_p, c_void_p, POINTER(c_void_p)],
        "palpate_simulation_destroy": [c_void_p],
        "palpate_step": [c_void_p, POINTER(Pose), POINTER(Wrench)],
        "palpate_nodes": [c_void_p, c_uint32, c_void_p, c_size_t, POINTER(c_size_t)],
    }.items():
        function = getattr(palpate, name)
        function.argtypes, function.restype, function.errcheck = arguments, c_int32, checked
    return palpate


def main(scene_file, steps, path="libpalpate.so"):
    palpate = library(path)
    context, scene, simulation = c_void_p(), c_void_p(), c_void_p()
    palpate.palpate_context_create(byref(kept()), byref(context))
    palpate.palpate_scene_load(scene_file.encode(), byref(scene))
    palpate.palpate_simulation_create(context, scene, byref(simulation))
    palpate.palpate_scene_destroy(scene)
    wrench = Wrench(size=ctypes.sizeof(Wrench))
    for _ in range(int(steps)):
        palpate.palpate_step(simulation, None, byref(wrench))
        print(wrench.step, *(f"{x:.17g}" for x in wrench.force), wrench.flags)
    palpate.palpate_simulation_destroy(simulation)
    palpate.palpate_context_destroy(context)


if __name__ == "__main__":
    main(*sys.argv[1:])
