"""Fits values of a scene to measured curves of force."""

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from . import native
from .errors import InputError
from .flags import Flags
from .plain import Floats
from .scene import Scene

Verdict: TypeAlias = Literal["fits", "other shape", "no value fits", "few points", "at bound", "not converged"]


class Estimate(NamedTuple):
    """A fitted value."""

    key: str
    """Dotted key of the scene."""
    initial: float
    """The value in the scene as it was given."""
    value: float
    """The value with the least sum of squares, in the key's unit."""
    standard_error: float
    """Standard error of the value, from the scatter of the measurement about the curve."""
    interval: tuple[float, float]
    """Interval that holds the true value in 95 % of cases, if the residuals are independent."""


class Fit(NamedTuple):
    """Result of :func:`fit`."""

    estimates: list[Estimate]
    """The fitted values."""
    correlation: Floats
    """Correlation of the errors of each two values, shape (P, P)."""
    scatter: float
    """Root of the mean square of the residuals, N."""
    verdict: Verdict
    """``fits``: what is left looks like noise. ``other shape``: what is left has a pattern, and the intervals are too
    narrow. ``no value fits``: no value gives such a curve. ``few points``: too few to tell.
    ``at bound``: a value ended at a bound, where its interval is cut off. ``not converged``: the search ended too early."""
    force: Floats
    """Force of the fitted scene at each measured point, N, shape (N,)."""
    extrapolated: int
    """Number of points that lie deeper than the fitted scene presses; its curve is extended there, by a twentieth at most."""
    simulations: int
    """Number of simulations."""
    flags: Flags
    """Flags of all steps of the fitted scene."""
    scene: Scene
    """The scene with the fitted values."""


def fit(
    scene: Scene,
    free: str | Sequence[str] | Mapping[str, tuple[float, float] | None],
    *,
    force: ArrayLike,
    time: ArrayLike | None = None,
    indentation: ArrayLike | None = None,
    device: str | int | None = None,
) -> Fit:
    """Find the values of a scene with which its contact force agrees best with a measured curve, by least squares.

    The tool of the scene must move as in the measurement. The search begins at the scene's values; a fit of one value
    takes at most fifteen simulations.

    Args:
        scene: The scene.
        free: Dotted keys of the values to fit, such as ``"body.material.young"``; a mapping gives bounds, or ``None``.
        force: Measured magnitude of the force, N, shape (N,).
        time: Time of each point since the start of the scene, s, shape (N,).
        indentation: In place of ``time``: indentation of each point since first touch, m, shape (N,).
        device: Part of the name, or the index, of the Vulkan device; ``None``: the first usable one.

    Raises:
        InputError: A key has no number in the scene, or the scene does not press as deep as was measured.
        SimulationError: A simulation failed, or the force does not depend on a key.
    """
    if (time is None) == (indentation is None):
        raise InputError("give either time or indentation, not both")
    keys: Mapping[str, tuple[float, float] | None]
    keys = free if isinstance(free, Mapping) else dict.fromkeys([free] if isinstance(free, str) else free)
    x = np.asarray(indentation if time is None else time, np.float64)
    y = np.asarray(force, np.float64)
    if x.ndim != 1 or x.shape != y.shape:
        raise InputError(f"the measured arrays have the shapes {x.shape} and {y.shape}; give two columns of one length")
    file, tables = scene._file, scene._tables  # pyright: ignore[reportPrivateUsage]
    if scene._surfaces or scene._layers:  # pyright: ignore[reportPrivateUsage]
        raise InputError("a scene with meshes in memory cannot be fitted; write them to files")
    found = native.fit(
        str(file), tables, time is not None, x, y, list(keys.items()), None if device is None else str(device)
    )
    estimates, correlation, scatter, verdict, forces, extrapolated, simulations, flags = found
    made = [Estimate(key, begun, best, error, (low, high)) for key, begun, best, error, (low, high) in estimates]
    values = {estimate.key: estimate.value for estimate in made}
    return Fit(
        estimates=made,
        correlation=np.array(correlation),
        scatter=scatter,
        verdict=verdict,
        force=forces,
        extrapolated=extrapolated,
        simulations=simulations,
        flags=Flags(flags),
        scene=scene.with_values(values),
    )
