"""Names of the types that the compiled part of the package takes and gives."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Indices: TypeAlias = NDArray[np.uint32]
Mesh: TypeAlias = tuple[str, Floats, Indices]
"""Name, points and corners."""
Vector: TypeAlias = tuple[float, float, float]
Quaternion: TypeAlias = tuple[float, float, float, float]
PlainPose: TypeAlias = tuple[Vector, Quaternion]
ReadPose: TypeAlias = tuple[list[float], list[float]]
PlainTool: TypeAlias = tuple[list[float], list[float], ReadPose, ReadPose]
"""Force, torque, pose of the tool, pose of its device."""
Report: TypeAlias = tuple[
    int,
    float,
    list[PlainTool],
    int | None,
    float | None,
    int,
    float,
    int,
    float,
    list[list[float]],
    list[tuple[str, list[float], list[float]]],
    tuple[int, int, int, int],
]
"""Step, time, the tools, contacts, greatest depth, iterations, residual, flags, microseconds,
probes, reactions (name, force, torque), and the work."""
Tick: TypeAlias = tuple[float, ReadPose, ReadPose, list[float], list[float], list[float], float]
"""Time, poses of device and tool, force and torque played, contact force, and age of the newest wrench."""
PlainSession: TypeAlias = tuple[str, int, int, float, float, str | None, list[str], str]
"""Name of the tool where there are several, ticks, steps, pace, greatest force, why it ended early, notes, and all of it as
JSON."""
PlainContacts: TypeAlias = tuple[Indices, Indices, Floats, Floats, Floats, Floats, Floats, Floats]
Answer: TypeAlias = tuple[Indices, Indices, Floats, Floats, Indices, Floats, Floats, int]
