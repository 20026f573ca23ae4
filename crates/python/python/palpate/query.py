"""Where the skins of two rigid bodies overlap, without any simulation."""

from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from . import native
from .flags import Flags
from .plain import Floats, Indices, Vector
from .scene import Scene
from .simulation import PoseLike
from .simulation import _pose as plain_pose  # pyright: ignore[reportPrivateUsage]


class Overlap(NamedTuple):
    """Skin vertices of either body that lie within the other: N of them, by columns; first those of body a."""

    body: Indices
    """The body that the vertex belongs to, 0 for a and 1 for b, shape (N,)."""
    vertex: Indices
    """Index of the vertex in that body's skin, shape (N,)."""
    depth: Floats
    """Depth along the normal, m, shape (N,)."""
    normal: Floats
    """Unit contact normal, world axes, from a to b, shape (N, 3)."""
    triangle: Indices
    """Triangle of the other body's skin that the ray along the normal hits, shape (N,)."""
    barycentric: Floats
    """Barycentric coordinates of that hit in the triangle, shape (N, 3)."""
    area: Floats
    """Half the area of the skin around the vertex, projected along the normal, m^2, shape (N,)."""
    flags: Flags
    """Warnings, such as a vertex beyond the depth limit."""


class Query:
    """The proximity query of two rigid bodies.

    Args:
        scene: A scene with both bodies, which must be rigid.
        a: Name of one body.
        b: Name of the other body.
        device: Part of the name, or the index, of the Vulkan device; ``None``: the first usable one.
    """

    def __init__(self, scene: Scene, a: str, b: str, *, device: str | int | None = None) -> None:
        plain = scene._native  # pyright: ignore[reportPrivateUsage]
        self._native = native.Query(plain, a, b, None if device is None else str(device))

    def run(
        self,
        a: PoseLike,
        b: PoseLike,
        *,
        direction: "Sequence[float] | NDArray[np.floating] | None" = None,
        depth_limit: float | None = None,
    ) -> Overlap:
        """Find where the skins overlap with the bodies in these poses.

        Args:
            a: Pose of body a.
            b: Pose of body b.
            direction: World direction from a to b along which depth is measured; ``None``: the query finds it.
            depth_limit: Depth above which a flag is raised, m; ``None``: the last limit, at first a tenth of the smaller
                body's extent.
        """
        axis = None if direction is None else cast(Vector, tuple(float(x) for x in direction))
        answer = self._native.run(plain_pose(a), plain_pose(b), axis, depth_limit)
        body, vertex, depth, normal, triangle, barycentric, area, flags = answer
        return Overlap(body, vertex, depth, normal, triangle, barycentric, area, Flags(flags))
