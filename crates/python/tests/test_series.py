"""Tests that other programs read what `palpate run --export` writes."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from palpate import Scene, Simulation

STEPS = 25
TIMES = [0.01 * k for k in range(6)]
# The Python that Debian's package python3-paraview extends.
PARAVIEW = "/usr/bin/python3"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, scene: str) -> Path:
    """A folder with a scene and two series of it, compressed and not."""
    folder = tmp_path_factory.mktemp("series")
    (folder / "scene.toml").write_text(scene)
    for name, level in (("series", "1"), ("plain", "0")):
        words = ["run", "scene.toml", "--steps", str(STEPS), "--every", "5", "--export", name, "--compression", level]
        done = subprocess.run([sys.executable, "-m", "palpate", *words], cwd=folder, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    return folder


def last(folder: Path, series: str) -> Any:
    """The last grid of a series."""
    pyvista: Any = pytest.importorskip("pyvista")
    reader = pyvista.PVDReader(folder / f"{series}.pvd")
    assert np.allclose(reader.time_values, TIMES)
    reader.set_active_time_value(reader.time_values[-1])
    return reader.read()[0]


@pytest.mark.parametrize("name", ["series", "plain"])
def test_pyvista_reads_the_state_of_the_simulation(folder: Path, name: str) -> None:
    simulation = Simulation(Scene.load(folder / "scene.toml"))
    for _ in range(STEPS):
        simulation.step()
    layer = last(folder / name, "block-layer")
    np.testing.assert_array_equal(layer.points, simulation.nodes("block"))
    np.testing.assert_array_equal(layer.cells_dict[10], simulation.tetrahedra("block"))
    np.testing.assert_array_equal(layer["velocity"], simulation.node_velocities("block").astype(np.float32))
    stress = simulation.stress("block")
    six = stress[:, [0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]].astype(np.float32)
    np.testing.assert_array_equal(layer["cauchy_stress"], six)
    principal = np.linalg.eigvalsh(stress)[:, ::-1]
    np.testing.assert_allclose(layer["principal_stress"], principal, atol=1e-6 * np.abs(principal).max())
    energy = simulation.strain_energy_density("block").astype(np.float32)
    np.testing.assert_array_equal(layer["strain_energy_density"], energy)
    assert 0.3 < layer["least_stretch"].min() < 0.99 and layer["least_stretch"].max() < 1.0001
    skin = last(folder / name, "block-skin")
    np.testing.assert_array_equal(skin["contact_force"], simulation.contact_forces("block").astype(np.float32))
    np.testing.assert_allclose(skin.points, simulation.skin("block").positions, atol=1e-8)
    contacts, points = simulation.contacts(), last(folder / name, "contacts")
    np.testing.assert_array_equal(points.points, contacts.position)
    np.testing.assert_array_equal(points["force"], contacts.force.astype(np.float32))
    assert layer["contact_force"].sum(axis=0)[1] == pytest.approx(skin["contact_force"].sum(axis=0)[1], rel=1e-5)


def test_meshio_reads_a_layer(folder: Path) -> None:
    meshio: Any = pytest.importorskip("meshio")
    for name in ("series", "plain"):
        mesh = meshio.read(folder / name / f"block-layer-{STEPS:06}.vtu")
        layer = last(folder / name, "block-layer")
        np.testing.assert_array_equal(mesh.points, layer.points)
        np.testing.assert_array_equal(mesh.cells_dict["tetra"], layer.cells_dict[10])
        np.testing.assert_array_equal(mesh.cell_data["von_mises_stress"][0], layer["von_mises_stress"])


def assert_bright_under_the_tool(picture: Any) -> None:
    """Asserts that a picture in gray, of half the block before white, is bright below the tool's place."""
    block = np.argwhere(picture < 255)
    (top, left), (bottom, right) = block.min(axis=0), block.max(axis=0)
    assert (right - left) > 1.5 * (bottom - top) > 50
    # Bright is high: in the middle below the tool more than at the upper corners.
    height, width = bottom - top, right - left
    middle = picture[top + height // 3, left + width // 2]
    corner = picture[top + height // 3, left + width // 10]
    assert middle < 255 and middle > 1.5 * corner


def test_a_picture_shows_the_stress_under_the_tool(folder: Path) -> None:
    pyvista: Any = pytest.importorskip("pyvista")
    layer = last(folder / "series", "block-layer")
    plotter = pyvista.Plotter(off_screen=True, window_size=[300, 300])
    plotter.set_background("white")
    plotter.add_mesh(layer.clip("z"), scalars="von_mises_stress", cmap="gray", lighting=False, show_scalar_bar=False)
    plotter.view_xy()
    assert_bright_under_the_tool(np.asarray(plotter.screenshot(return_img=True))[:, :, 0])


@pytest.mark.paraview
@pytest.mark.parametrize("name", ["series", "plain"])
def test_paraview_shows_what_pyvista_reads(folder: Path, name: str) -> None:
    pyvista: Any = pytest.importorskip("pyvista")
    script, picture = Path(__file__).with_name("paraview_series.py"), folder / f"{name}.png"
    series = ["block-layer", "block-skin", "tool-skin", "contacts"]
    words = ["xvfb-run", "-a", PARAVIEW, str(script), str(folder / name), str(picture), *series]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert list(found) == series
    for each, shown in found.items():
        np.testing.assert_allclose(shown["times"], TIMES, atol=1e-12)
        grid = last(folder / name, each)
        assert (shown["points"], shown["cells"]) == (grid.n_points, grid.n_cells)
        for kind in ("point_data", "cell_data"):
            arrays = getattr(grid, kind)
            assert set(shown[kind]) == set(arrays.keys())
            for array, ranges in shown[kind].items():
                values = np.asarray(arrays[array]).reshape(len(arrays[array]), -1)
                bounds = np.stack([values.min(axis=0), values.max(axis=0)], axis=1)
                np.testing.assert_allclose(ranges, bounds, rtol=1e-6, err_msg=f"{each} {array}")
    assert found["contacts"]["points"] > 0 and "von_mises_stress" in found["block-layer"]["cell_data"]
    assert_bright_under_the_tool(np.asarray(pyvista.read(picture).active_scalars).reshape(300, 300, -1)[::-1, :, 0])
