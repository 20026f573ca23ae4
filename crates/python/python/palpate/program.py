"""Commands of the program as functions."""

import os
from collections.abc import Sequence
from pathlib import Path

from . import native
from .scene import Scene, scene_file


def prepare(
    surface: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    units: str = "m",
    scale: float = 1.0,
    cells: int = 40,
) -> Scene:
    """Make a soft body from a closed surface: repair it, fill it with tetrahedra, and write a scene that presses a sphere
    into it.

    Args:
        surface: A file: OBJ, STL, PLY, glTF, VTP, VTU or legacy VTK.
        out: Folder that gets ``scene.toml``, the body's meshes, a report and a picture.
        units: Unit of the file: ``"m"``, ``"cm"``, ``"mm"`` or ``"in"``.
        scale: Factor by which the file's lengths are multiplied besides.
        cells: Number of lattice cells, which are filled with tetrahedra, along the body's largest extent.

    Returns:
        The scene that was written.
    """
    words = ["prepare", os.fspath(surface), "--out", os.fspath(out), "--units", units]
    words += ["--scale", repr(float(scale)), "--cells", str(cells)]
    native.command(words)
    return Scene.load(Path(out) / "scene.toml")


def film(
    scene: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    size: tuple[int, int] = (1280, 720),
    fps: int = 25,
    speed: float = 1.0,
    seconds: float | None = None,
    show: Sequence[str] = (),
    camera: tuple[float, float] | tuple[float, float, float] | None = None,
) -> None:
    """Render a scene from the first step to the last as an animated PNG, or as images in a folder.

    Args:
        scene: A scene file, or the name of a scene inside the package.
        out: ``FILE.png`` for an animated PNG, which browsers show; any other name is a folder for one image a frame.
        size: Width and height, pixels.
        fps: Frames per second.
        speed: Simulated seconds per second of film: 1 is real time, 0.1 is slow motion.
        seconds: Time to simulate, s; ``None``: up to the last key of the scene's trajectories.
        show: As in :meth:`Simulation.picture`.
        camera: As in :meth:`Simulation.picture`.
    """
    words = ["film", os.fspath(scene_file(scene)), "--out", os.fspath(out), "--fps", str(fps), "--speed", repr(float(speed))]
    words += ["--size", f"{size[0]}x{size[1]}"]
    words += ["--seconds", repr(float(seconds))] if seconds is not None else []
    words += ["--show", ",".join(show)] if show else []
    words += [f"--camera={','.join(map(str, camera))}"] if camera is not None else []
    native.command(words)
