"""Meshes from files of formats that the engine does not read itself."""

import importlib
import os
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

from .errors import InputError
from .plain import Floats, Indices


@dataclass(frozen=True)
class MeshFile:
    """A mesh that was read from a file, in the file's units.

    Attributes:
        points: Positions, (N, 3).
        triangles: Indices of the corners of its faces, (M, 3); quadrangles are cut in two.
        tetrahedra: Indices of the corners of its four-node tetrahedra, (K, 4).
    """

    points: Floats
    triangles: Indices
    tetrahedra: Indices

    @property
    def surface(self) -> tuple[Floats, Indices]:
        """Points and triangles, as ``surfaces`` of :class:`Scene` takes them."""
        return self.points, self.triangles

    @property
    def layer(self) -> tuple[Floats, Indices]:
        """Points and tetrahedra, as ``layers`` of :class:`Scene` takes them."""
        return self.points, self.tetrahedra


def read_mesh(file: str | os.PathLike[str]) -> MeshFile:
    """Read a mesh of any format that the package meshio reads, such as OFF, Abaqus, ANSYS, MED, Nastran or XDMF.

    OBJ, STL, PLY, glTF, Gmsh, TetGen and VTK need no such detour: name the file in the scene.

    Raises:
        InputError: meshio is not installed, or cannot read the file, or the file has neither faces nor tetrahedra.
    """
    try:
        meshio: Any = importlib.import_module("meshio")
    except ImportError:
        raise InputError(f"{file}: needs the package meshio; install it: pip install meshio") from None
    try:
        mesh: Any = meshio.read(os.fspath(file))
    # meshio ends the process where no reader fits.
    except (Exception, SystemExit) as error:
        problem = "no reader fits" if isinstance(error, SystemExit) else " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{file}: meshio cannot read it: {problem}; give a mesh file") from None
    points = np.asarray(mesh.points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"{file}: its points have {points.shape[-1]} coordinates; give a mesh in three dimensions")
    quadrangles = _cells(mesh, "quad", 4)
    halves = quadrangles[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    triangles = np.concatenate([_cells(mesh, "triangle", 3), halves])
    tetrahedra = _cells(mesh, "tetra", 4)
    if not len(triangles) and not len(tetrahedra):
        kinds = ", ".join(sorted({block.type for block in mesh.cells})) or "no cells"
        raise InputError(f"{file}: has {kinds}; give a mesh of triangles, quadrangles or four-node tetrahedra")
    others = {block.type: len(block.data) for block in mesh.cells if block.type not in ("triangle", "quad", "tetra")}
    if others:
        left_out = ", ".join(f"{count} {kind}" for kind, count in sorted(others.items()))
        warnings.warn(f"{file}: cells of other types were left out: {left_out}", stacklevel=2)
    return MeshFile(points, triangles, tetrahedra)


def _cells(mesh: Any, kind: str, corners: int) -> Indices:
    """The cells of one type, from all blocks."""
    blocks = [np.asarray(block.data, dtype=np.uint32) for block in mesh.cells if block.type == kind]
    return np.concatenate([np.empty((0, corners), dtype=np.uint32), *blocks])
