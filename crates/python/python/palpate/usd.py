"""Bodies over time as a USD stage, for Blender, Omniverse and other programs that render."""

import importlib
import os
import tempfile
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import InputError, OutputError
from .simulation import Simulation


class UsdStage:
    """A USD stage that is being filled: the skins of all bodies and of the tool as meshes whose points move.

    Needs the package usd-core. Lengths are in metres and points in world axes; up is z if gravity is mainly along z, else
    y. The meshes are ``/World/NAME``; characters of a name that USD does not allow become ``_``. A time code is a frame:
    simulated time times ``fps``. All frames are kept in memory until :meth:`close` writes the file, which then is
    complete; in a ``with`` statement it is called at the end, also after an exception.

    Args:
        file: The file to write: ``.usdc`` or ``.usd`` (binary), or ``.usda`` (text). An existing one is replaced.
        simulation: The simulation to take the bodies from.
        fps: Frames per second of simulated time.

    Raises:
        InputError: usd-core is not installed, or an argument cannot be used.
    """

    def __init__(self, file: str | os.PathLike[str], simulation: Simulation, *, fps: float = 25.0) -> None:
        self._file = Path(file)
        if self._file.suffix.lower() not in (".usd", ".usda", ".usdc"):
            raise InputError(f"{file}: is not a name of a USD file; let it end in .usdc, .usd or .usda")
        if not self._file.parent.is_dir():
            raise InputError(f"{file}: its folder does not exist; make it, or give another")
        if not 0.0 < fps < float("inf"):
            raise InputError(f"fps is {fps}; give a number above 0")
        try:
            self._pxr: Any = importlib.import_module("pxr")
            for module in ("Tf", "Usd", "UsdGeom", "Vt"):
                importlib.import_module(f"pxr.{module}")
        except ImportError:
            raise InputError(f"{file}: needs the package usd-core; install it: pip install usd-core") from None
        self._simulation, self._fps = simulation, fps
        self._meshes: dict[int, Any] = {}
        self._before: dict[int, NDArray[np.float32]] = {}
        self._stage: Any = self._new_stage()

    def add(self) -> None:
        """Add a frame: the bodies as they are now, at the simulation's time.

        Raises:
            InputError: The stage is closed, or the simulation has not gone on since the last frame.
        """
        if self._stage is None:
            raise InputError(f"{self._file}: is closed; make another UsdStage")
        code = self._simulation.time * self._fps
        has_frames = self._stage.HasAuthoredTimeCodeRange()
        if has_frames and code <= self._stage.GetEndTimeCode():
            raise InputError(f"{self._file}: has a frame at {self._simulation.time} s or later; add frames as time goes on")
        if not has_frames:
            self._stage.SetStartTimeCode(code)
        for index, mesh in self._meshes.items():
            points = self._simulation.skin(index).positions
            if index in self._before and np.array_equal(points, self._before[index]):
                continue
            # A body that was still until now stays so up to the frame before; USD interpolates between frames.
            if index in self._before:
                self._put(mesh, self._before[index], self._stage.GetEndTimeCode())
            self._put(mesh, points, code)
            self._before[index] = points.copy()
        self._stage.SetEndTimeCode(code)

    def close(self) -> None:
        """Write the file; once it is written, a further call does nothing.

        Raises:
            OutputError: The file cannot be written. The frames are kept, and it may be tried again.
        """
        if self._stage is None:
            return
        try:
            with tempfile.TemporaryDirectory(prefix=".palpate-", dir=self._file.parent) as folder:
                unfinished = os.path.join(folder, self._file.name)
                self._stage.Export(unfinished)
                os.replace(unfinished, self._file)
        except (OSError, self._pxr.Tf.ErrorException) as error:
            problem = " ".join(str(error).split())
            raise OutputError(f"{self._file}: cannot be written: {problem}; make room and close again") from error
        self._stage = None

    def __enter__(self) -> "UsdStage":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _new_stage(self) -> Any:
        """A stage with a mesh for each body that has a skin."""
        geometry, usd = self._pxr.UsdGeom, self._pxr.Usd
        stage = usd.Stage.CreateInMemory()
        step = self._simulation.scene.tables.get("step", {})
        gravity = np.abs(np.asarray(step.get("gravity", (0.0, -1.0, 0.0)), dtype=float))
        is_z_up = gravity[2] > gravity[1]
        geometry.SetStageUpAxis(stage, geometry.Tokens.z if is_z_up else geometry.Tokens.y)
        geometry.SetStageMetersPerUnit(stage, 1.0)
        stage.SetTimeCodesPerSecond(self._fps)
        stage.SetFramesPerSecond(self._fps)
        world = geometry.Xform.Define(stage, "/World")
        stage.SetDefaultPrim(world.GetPrim())
        names = [*self._simulation.bodies, *(["tool"] if self._simulation.scene.has_tool else [])]
        for index, name in enumerate(names):
            triangles = self._simulation.triangles(index)
            if len(triangles):
                self._meshes[index] = self._mesh(stage, name, triangles)
        return stage

    def _mesh(self, stage: Any, name: str, triangles: Any) -> Any:
        valid = self._pxr.Tf.MakeValidIdentifier(name)
        path, copy = f"/World/{valid}", 1
        while stage.GetPrimAtPath(path):
            path, copy = f"/World/{valid}_{copy}", copy + 1
        mesh = self._pxr.UsdGeom.Mesh.Define(stage, path)
        mesh.GetPrim().SetDisplayName(name)
        ints = self._pxr.Vt.IntArray.FromNumpy
        mesh.CreateFaceVertexCountsAttr(ints(np.full(len(triangles), 3, np.int32)))
        mesh.CreateFaceVertexIndicesAttr(ints(np.ascontiguousarray(triangles, np.int32).ravel()))
        mesh.CreateSubdivisionSchemeAttr("none")
        return mesh

    def _put(self, mesh: Any, points: NDArray[np.float32], code: float) -> None:
        """Sets the points of a mesh at a time code, and their bounds."""
        vectors = self._pxr.Vt.Vec3fArray.FromNumpy
        mesh.GetPointsAttr().Set(vectors(np.ascontiguousarray(points)), code)
        mesh.GetExtentAttr().Set(vectors(np.stack([points.min(axis=0), points.max(axis=0)])), code)
