"""Tests of USD stages, read back by usd-core."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from palpate import InputError, OutputError, Scene, Simulation, UsdStage

TABLES: dict[str, Any] = {
    "body": [
        {
            "name": "my-pad",
            "layer": {"box": [[-0.03, -0.03, -0.03], [0.03, 0.03, 0.0]], "cells": [6, 6, 4]},
            "material": {"young": 2e4, "poisson": 0.45, "density": 1000.0},
            "core": [{"name": "table", "bind": {"box": [[-1.0, -1.0, -1.0], [1.0, 1.0, -0.029]]}}],
        },
        {"name": "my_pad", "surface": {"mesh": "wedge"}, "position": [0.1, 0.0, 0.0]},
    ],
    "tool": {"sphere": 0.01, "mass": 0.05, "position": [0.0, 0.0, 0.011]},
    "coupling": {"stiffness": 1000.0, "damping": 10.0},
    "step": {"dt": 0.002, "gravity": [0.0, 0.0, -9.81]},
}
CORNERS = [[0.0, 0.0, 0.0], [0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.01]]
FACES = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]


def scene() -> Scene:
    """A soft pad, a rigid wedge beside it, and a tool above."""
    return Scene(TABLES, surfaces={"wedge": (CORNERS, FACES)})


@pytest.mark.parametrize("ending", ["usdc", "usda"])
def test_usd_core_reads_every_frame(tmp_path: Path, ending: str) -> None:
    pxr: Any = pytest.importorskip("pxr.UsdGeom")
    usd: Any = pytest.importorskip("pxr.Usd")
    file = tmp_path / f"press.{ending}"
    simulation = Simulation(scene())
    frames: list[list[Any]] = []
    with UsdStage(file, simulation, fps=100.0) as stage:
        for step in range(26):
            if step % 5 == 0:
                stage.add()
                frames.append([simulation.skin(body).positions.copy() for body in (0, 1, "tool")])
            simulation.step((0.0, 0.0, 0.011 - 0.0002 * step))
        assert not file.exists()
    opened = usd.Stage.Open(str(file))
    assert (opened.GetStartTimeCode(), opened.GetEndTimeCode()) == pytest.approx((0.0, 5.0))
    assert (opened.GetTimeCodesPerSecond(), pxr.GetStageMetersPerUnit(opened), pxr.GetStageUpAxis(opened)) == (100.0, 1.0, "Z")
    assert str(opened.GetDefaultPrim().GetPath()) == "/World"
    paths = ["/World/my_pad", "/World/my_pad_1", "/World/tool"]
    assert [str(prim.GetPath()) for prim in opened.Traverse()] == ["/World", *paths]
    for body, path in enumerate(paths):
        mesh = pxr.Mesh(opened.GetPrimAtPath(path))
        triangles = simulation.triangles(body)
        assert set(mesh.GetFaceVertexCountsAttr().Get()) == {3}
        np.testing.assert_array_equal(np.array(mesh.GetFaceVertexIndicesAttr().Get()), triangles.ravel())
        for code, skins in enumerate(frames):
            points = np.array(mesh.GetPointsAttr().Get(code))
            np.testing.assert_allclose(points, skins[body], atol=1e-9 if body else 1e-7)
            box = mesh.ComputeLocalBound(code, "default").ComputeAlignedRange()
            np.testing.assert_allclose([box.GetMin(), box.GetMax()], [points.min(axis=0), points.max(axis=0)], atol=1e-7)
    assert np.ptp([skins[0] for skins in frames], axis=0).max() > 1e-3
    assert sorted(path.name for path in tmp_path.iterdir()) == [file.name]


def test_a_body_that_stays_has_one_frame_until_it_moves(tmp_path: Path) -> None:
    pxr: Any = pytest.importorskip("pxr.UsdGeom")
    usd: Any = pytest.importorskip("pxr.Usd")
    weightless = scene().with_values({"step.gravity": [0.0, 0.0, 0.0]})
    simulation = Simulation(weightless)
    with UsdStage(tmp_path / "a.usd", simulation, fps=500.0) as stage:
        for step in range(6):
            stage.add()
            simulation.step((0.0, 0.0, 0.011 + 0.001 * max(step - 2, 0)))
    opened = usd.Stage.Open(str(tmp_path / "a.usd"))
    wedge, tool = (pxr.Mesh(opened.GetPrimAtPath(f"/World/{name}")).GetPointsAttr() for name in ("my_pad_1", "tool"))
    assert (wedge.GetTimeSamples(), tool.GetTimeSamples()) == ([0.0], [0.0, 3.0, 4.0, 5.0])
    points = [np.array(tool.Get(code)) for code in range(6)]
    np.testing.assert_allclose(points[2], points[0], atol=1e-8)
    np.testing.assert_array_equal(points[3], points[0])
    assert np.abs(points[4] - points[0]).max() > 1e-5


def test_what_was_reached_is_written(tmp_path: Path) -> None:
    usd: Any = pytest.importorskip("pxr.Usd")
    simulation = Simulation(scene())
    with pytest.raises(ZeroDivisionError), UsdStage(tmp_path / "a.usd", simulation) as stage:
        stage.add()
        raise ZeroDivisionError
    assert usd.Stage.Open(str(tmp_path / "a.usd")).GetPrimAtPath("/World/tool")


def test_mistakes_are_told(tmp_path: Path) -> None:
    pytest.importorskip("pxr.Usd")
    simulation = Simulation(scene())
    with pytest.raises(InputError, match=re.escape("a.obj: is not a name of a USD file; let it end in .usdc")):
        UsdStage("a.obj", simulation)
    with pytest.raises(InputError, match="fps is 0.0; give a number above 0"):
        UsdStage("a.usd", simulation, fps=0.0)
    with pytest.raises(InputError, match="its folder does not exist"):
        UsdStage(tmp_path / "none" / "a.usd", simulation)
    folder = tmp_path / "folder"
    folder.mkdir()
    stage = UsdStage(folder / "a.USD", simulation)
    stage.add()
    with pytest.raises(InputError, match="has a frame at 0.0 s or later"):
        stage.add()
    folder.rmdir()
    with pytest.raises(OutputError, match="cannot be written: .*; make room and close again"):
        stage.close()
    folder.mkdir()
    stage.close()
    assert [path.name for path in folder.iterdir()] == ["a.USD"]
    with pytest.raises(InputError, match="is closed"):
        stage.add()
