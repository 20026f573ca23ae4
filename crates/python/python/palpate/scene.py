"""Scenes: what is simulated."""

import copy
import hashlib
import json
import os
import tomllib
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any, Self, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike

from . import native
from .errors import InputError
from .plain import Indices, Mesh

Tables: TypeAlias = dict[str, Any]
"""Tables like those of a scene file, by key."""


_PARTS = {"forearm-bones"}
"""Files in the folders of the scenes that are parts of scenes."""


def shipped_scenes() -> list[str]:
    """Names of the scenes inside the package, which :meth:`Scene.load` takes."""
    return sorted(path.stem for path in _shipped().glob("*/*.toml") if path.stem not in _PARTS)


def _shipped() -> Path:
    return Path(str(resources.files("palpate"))) / "assets"


def scene_file(file: str | os.PathLike[str]) -> Path:
    """The path of a scene file, which may be named as a scene inside the package."""
    path = Path(file)
    if path.suffix == "" and not path.exists():
        found = sorted(_shipped().glob(f"*/{path.name}.toml"))
        if path.parent != Path() or not found or path.name in _PARTS:
            known = ", ".join(shipped_scenes())
            raise InputError(f"{file}: is neither a file nor a scene inside the package; give one of {known}")
        # Scenes of the paper come after those of the gallery and win where both have the same name.
        path = found[-1]
    return path


class Scene:
    """Bodies, tool, contact and settings of a simulation, checked.

    A scene is read from a file (:meth:`load`), from the text of one (:meth:`parse`), or made from tables with the keys of
    a scene file, and arrays. All units are SI; keys are those of the page "Scene files" of the book.

    Args:
        tables: The tables of a scene file as a dictionary. Arrays and NumPy numbers may stand for lists and numbers.
        surfaces: Triangle meshes by name: vertices (N, 3), which the body's ``scale`` turns into m, and triangles (M, 3),
            counter-clockwise seen from outside. A body uses one by ``surface = {"mesh": name}``.
        layers: Tetrahedral meshes by name: nodes (N, 3) and tetrahedra (M, 4). A body uses one by
            ``layer = {"mesh": name}``.
        folder: Folder to which relative paths in the tables are relative.
        name: Name of the scene in messages and results.

    Raises:
        InputError: A key is unknown or has a value that cannot be used.
    """

    def __init__(
        self,
        tables: Mapping[str, Any],
        *,
        surfaces: Mapping[str, tuple[ArrayLike, ArrayLike]] | None = None,
        layers: Mapping[str, tuple[ArrayLike, ArrayLike]] | None = None,
        folder: str | os.PathLike[str] = ".",
        name: str = "scene",
    ) -> None:
        self._tables: Tables = plain_value(dict(tables))
        self._surfaces = _meshes(surfaces)
        self._layers = _meshes(layers)
        self._file = Path(folder).absolute() / f"{name}.toml"
        self._native = native.Scene.build(str(self._file), self._tables, self._surfaces, self._layers)

    @classmethod
    def load(cls, file: str | os.PathLike[str]) -> Self:
        """Read a scene file; a name of :func:`shipped_scenes` reads a scene inside the package.

        Raises:
            InputError: The file cannot be read or has a mistake; the message names line, key and remedy.
        """
        path = scene_file(file)
        try:
            text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"{path}: cannot be read: {error}; give a scene file") from None
        return cls.parse(text, file=path)

    @classmethod
    def parse(cls, text: str, *, file: str | os.PathLike[str] = "scene.toml") -> Self:
        """Read the text of a scene file. Messages name ``file``, and relative paths are relative to its folder."""
        scene = cls.__new__(cls)
        scene._native = native.Scene.parse(os.fspath(file), text)
        scene._tables = tomllib.loads(text)
        scene._surfaces, scene._layers, scene._file = [], [], Path(file).absolute()
        return scene

    def with_values(self, values: Mapping[str, Any]) -> "Scene":
        """Make a scene in which some keys have other values.

        Args:
            values: New values by dotted key, such as ``{"body.head.material.young": 2e4}``. A table of a list is meant by
                its name, or by its index; where the list has a single table, both may be left out
                (``body.material.young``).

        Raises:
            InputError: A key leads nowhere, or a value cannot be used.
        """
        tables = self._tables
        for key, value in values.items():
            tables = native.Scene.with_value(tables, key, plain_value(value))
        scene = Scene.__new__(Scene)
        scene._tables, scene._surfaces, scene._layers = tables, self._surfaces, self._layers
        scene._file = self._file
        scene._native = native.Scene.build(str(self._file), tables, self._surfaces, self._layers)
        return scene

    def value(self, key: str) -> Any:
        """The value of a dotted key, as :meth:`with_values` takes it; ``None`` where the scene leaves the key out."""
        return native.Scene.value(self._tables, key)

    @property
    def tables(self) -> Tables:
        """A copy of the scene's tables."""
        return copy.deepcopy(self._tables)

    @property
    def name(self) -> str:
        """Name of the scene."""
        return self._native.name

    @property
    def bodies(self) -> list[str]:
        """Names of the bodies."""
        return self._native.bodies

    @property
    def has_tool(self) -> bool:
        """Whether the scene has a tool, which a haptic device leads."""
        return self._native.has_tool

    @property
    def dt(self) -> float:
        """Time step, s."""
        return self._native.dt

    @property
    def duration(self) -> float:
        """Time up to the last key of any trajectory, s; 1 s if there are no keys."""
        return self._native.duration

    @property
    def fingerprint(self) -> str:
        """Digest of all that the scene says; files that it names are not read."""
        digest = hashlib.sha256(json.dumps([self._tables, str(self._file)], sort_keys=True).encode())
        for name, points, corners in [*self._surfaces, *self._layers]:
            digest.update(name.encode() + points.tobytes() + corners.tobytes())
        return digest.hexdigest()

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_native"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._native = native.Scene.build(str(self._file), self._tables, self._surfaces, self._layers)

    def __repr__(self) -> str:
        return f"Scene({self.name!r}, bodies={self.bodies})"


def plain_value(value: Any) -> Any:
    """A value with lists and numbers instead of arrays and NumPy numbers."""
    match value:
        case np.ndarray() | np.generic():
            return cast(Any, value).tolist()
        case Mapping():
            return {str(key): plain_value(inner) for key, inner in cast(Mapping[str, Any], value).items()}
        case list() | tuple():
            return [plain_value(inner) for inner in cast(list[Any], value)]
        case os.PathLike():
            return os.fspath(cast("os.PathLike[str]", value))
        case _:
            return value


def _meshes(meshes: Mapping[str, tuple[ArrayLike, ArrayLike]] | None) -> list[Mesh]:
    made: list[Mesh] = []
    for name, (points, corners) in (meshes or {}).items():
        mesh = (name, np.asarray(points, np.float64), _indices(corners, name))
        _check_rows(mesh[1], name)
        _check_rows(mesh[2], name)
        made.append(mesh)
    return made


def _indices(corners: ArrayLike, name: str) -> Indices:
    array = np.asarray(corners)
    if array.dtype.kind not in "iu" or (array.size > 0 and not 0 <= array.min() <= array.max() < 2**32):
        raise InputError(f"mesh {name}: its indices are not whole numbers of 0 and more; give such numbers")
    return array.astype(np.uint32)


def _check_rows(array: "np.ndarray[Any, Any]", name: str) -> None:
    if array.ndim != 2:
        raise InputError(f"mesh {name}: an array has the shape {array.shape}; give rows and columns")

