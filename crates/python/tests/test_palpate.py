"""Tests of the Python package, which run against an installed wheel."""

import csv
import gc
import inspect
import subprocess
import sys
import threading
import weakref
from pathlib import Path
from typing import Any

import numpy as np
import palpate
import pytest
from palpate import Flags, InputError, Material, Pose, Sample, Scene, Simulation

BLOCK: dict[str, Any] = {
    "step": {"dt": 0.002, "gravity": [0.0, 0.0, 0.0]},
    "body": [
        {
            "name": "block",
            "layer": {"box": [[-0.03, -0.03, -0.03], [0.03, 0.0, 0.03]], "cells": [8, 4, 8]},
            "material": {"young": 2e4, "poisson": 0.45, "density": 1000.0},
            "core": [{"name": "table", "bind": {"box": [[-1.0, -1.0, -1.0], [1.0, -0.029, 1.0]]}}],
        }
    ],
    "tool": {"sphere": 0.01, "mass": 0.05, "position": [0.0, 0.011, 0.0]},
    "coupling": {"stiffness": 1000.0, "damping": 10.0},
    "drive": {"keys": [[0.0, 0.0, 0.011, 0.0], [0.05, 0.0, 0.004, 0.0]]},
}
"""A sphere that presses into a soft block."""


@pytest.fixture
def pressed() -> Simulation:
    """A simulation of BLOCK after all of its steps."""
    simulation = Simulation(Scene(BLOCK))
    assert simulation.run().flags == Flags(0)
    return simulation


def test_forces_have_the_bits_of_the_program(tmp_path: Path) -> None:
    scene = Path(palpate.__file__).parent / "assets/scenes/touch-head.toml"
    done = subprocess.run(
        [sys.executable, "-m", "palpate", "run", scene, "--steps", "60", "--out", tmp_path / "out"],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    with (tmp_path / "out/trace.csv").open() as file:
        rows = list(csv.DictReader(file))
    simulation = Simulation("touch-head")
    trace = simulation.run(60 * simulation.scene.dt)
    for axis, name in enumerate(("x", "y", "z")):
        expected = [float(row[f"force_{name}"]) for row in rows]
        assert trace.force[:, axis].tolist() == expected
    assert [report.contact_count for report in trace] == [int(row["contacts"]) for row in rows]
    assert trace[-1].force is not None and trace[-1].force.any()


def test_a_haptic_device_holds_the_tool_and_python_watches() -> None:
    simulation = Simulation(Scene(BLOCK))
    seen: list[Sample] = []
    session = simulation.hold(0.4, device="scripted", watch=seen.append, every=0.03)
    assert session.ended is None and session.steps > 10 and session.ticks > 200, session
    assert session.peak_force > 0.05 and session.summary["peak_force_n"] == session.peak_force
    assert 3 <= len(seen) <= 14, f"{len(seen)} samples in 0.4 s, one each 0.03 s wanted"
    times = [sample.time for sample in seen]
    assert times == sorted(times) and 0.2 < times[-1] <= 0.5
    assert np.allclose(seen[-1].device.position, (0.0, 0.004, 0.0), atol=1e-3)
    assert seen[-1].tool.position[1] > 0.004 and seen[-1].contact_force[1] > 0.05
    # The simulation goes on from where the loop left it.
    before = simulation.time
    assert simulation.step().time > before


def test_a_watcher_ends_the_haptic_loop_and_may_not_call_the_simulation() -> None:
    simulation = Simulation(Scene(BLOCK))
    session = simulation.hold(60.0, device="scripted", watch=lambda sample: sample.time < 0.1)
    assert session.ended == "it was stopped"

    def steps(_: Sample) -> None:
        simulation.step()

    with pytest.raises(InputError, match="in its haptic loop"):
        simulation.hold(60.0, device="scripted", watch=steps)
    assert simulation.time > 0.0
    with pytest.raises(InputError, match="no haptic device phantom; give one of"):
        simulation.hold(1.0, device="phantom")
    with pytest.raises(InputError, match="give finite times above 0"):
        simulation.hold(float("inf"))
    with pytest.raises(InputError, match="no tool"):
        Simulation(Scene({"body": BLOCK["body"]})).hold(1.0)


@pytest.mark.parametrize("samples", ["vertices", "triangles"])
def test_contacts_add_up_to_the_force(samples: str) -> None:
    pressed = Simulation(Scene({**BLOCK, "contact": {"samples": samples}}))
    pressed.run()
    report = pressed.step()
    contacts = pressed.contacts()
    count = len(contacts.vertex)
    assert count == report.contact_count and count > 3
    assert report.force is not None and report.force[1] > 0.1
    tool = len(pressed.bodies)
    signs = np.where(contacts.bodies[:, 0] == tool, 1.0, -1.0)
    together = (signs[:, None] * contacts.force).sum(axis=0)
    np.testing.assert_allclose(together, report.force, atol=1e-5 * float(np.linalg.norm(report.force)))
    # So do the forces on the vertices of the skins.
    on_block = pressed.contact_forces("block")
    assert on_block.shape == pressed.skin("block").positions.shape
    np.testing.assert_allclose(-on_block.sum(axis=0), report.force, atol=1e-5 * float(np.linalg.norm(report.force)))
    positions = pressed.skin("block").positions[contacts.vertex[signs < 0]]
    # A triangle's centre of pressure is nearest to that corner: less than a cell of 7.5 mm away.
    away = np.linalg.norm(positions - contacts.position[signs < 0], axis=1)
    assert away.max() < (1e-7 if samples == "vertices" else 0.0075)
    assert samples == "vertices" or away.max() > 1e-4


def test_skins_are_views_that_the_next_call_changes(pressed: Simulation) -> None:
    skin = pressed.skin("block")
    assert skin.positions.base is not None and not skin.positions.flags.owndata
    assert skin.positions.dtype == np.float32 and not skin.positions.flags.writeable
    before = skin.positions.copy()
    kept = skin.positions
    assert np.allclose(np.linalg.norm(skin.normals, axis=1), 1.0, atol=1e-5)
    pressed.step(Pose((0.0, 0.05, 0.0)))
    np.testing.assert_array_equal(kept, before)
    again = pressed.skin("block")
    assert np.shares_memory(kept, again.positions)
    assert not np.array_equal(kept, before)
    tool = pressed.skin("tool").positions
    radii = np.linalg.norm(tool - tool.mean(axis=0), axis=1)
    assert np.allclose(radii, 0.01, rtol=0.05)
    assert pressed.skin(np.uint32(0)).positions.shape == kept.shape


def test_the_memory_of_a_skin_outlives_its_simulation() -> None:
    simulation = Simulation(Scene(BLOCK))
    kept = simulation.skin("block").positions
    before, gone = kept.copy(), weakref.ref(simulation)
    del simulation
    gc.collect()
    assert gone() is None
    np.testing.assert_array_equal(kept, before)


def test_bodies_and_meshes(pressed: Simulation) -> None:
    nodes, tetrahedra = pressed.nodes("block"), pressed.tetrahedra(0)
    assert tetrahedra.shape[1] == 4 and tetrahedra.max() == len(nodes) - 1
    assert pressed.node_velocities().shape == nodes.shape
    stress, energy = pressed.stress("block"), pressed.strain_energy_density("block")
    assert stress.shape == (len(tetrahedra), 3, 3) and energy.shape == (len(tetrahedra),)
    np.testing.assert_array_equal(stress, stress.transpose(0, 2, 1))
    assert energy.min() >= 0.0 and energy.max() > 0.0
    # Under the tool the block is pressed along y.
    assert stress[np.argmax(energy), 1, 1] < -10.0
    assert pressed.stress("tool").shape == (0, 3, 3)
    triangles = pressed.triangles("block")
    assert triangles.max() == len(pressed.skin("block").positions) - 1
    assert pressed.nodes("tool").shape == (0, 3)
    with pytest.raises(InputError, match="block, tool"):
        pressed.nodes("blok")
    with pytest.raises(InputError, match="index below 2"):
        pressed.nodes(2)


def test_a_state_continues_to_the_last_bit(pressed: Simulation) -> None:
    state = pressed.save()
    first = pressed.run(0.006).force
    pressed.restore(state)
    second = pressed.run(0.006).force
    assert len(first) == 3
    np.testing.assert_array_equal(first, second)
    assert not np.array_equal(first[0], first[1])
    with pytest.raises(InputError, match="damaged"):
        pressed.restore(state[:-1] + bytes([state[-1] ^ 1]))


def test_materials_contact_and_coupling_change(pressed: Simulation) -> None:
    state = pressed.save()
    before = pressed.step().force
    assert before is not None
    pressed.restore(state)
    (material,) = pressed.materials()
    assert material == Material(2e4, 0.45, 1000.0)
    pressed.set_material(material._replace(young=1e4))
    softer = pressed.run(0.1).force[-1]
    assert 0.3 * before[1] < softer[1] < 0.95 * before[1]
    with pytest.raises(InputError, match="poisson"):
        pressed.set_material(material._replace(poisson=0.5))
    pressed.set_contact(stiffness=1e7)
    assert pressed.run(0.1).force[-1][1] < softer[1]
    pressed.set_coupling(1.0)
    assert pressed.run(0.2).force[-1][1] < 0.1 * before[1]


def test_scenes_from_arrays_are_those_from_files(tmp_path: Path) -> None:
    corners = np.array([[x, y, z] for x in (0, 30) for y in (0, 30) for z in (0, 30)], np.float64)
    squares = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = np.array([[a, b, c] for a, b, c, _ in squares] + [[a, c, d] for a, _, c, d in squares])
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    lines += ["f " + " ".join(str(i + 1) for i in triangle) for triangle in triangles]
    (tmp_path / "cube.obj").write_text("\n".join(lines) + "\n")
    body: dict[str, Any] = {
        "name": "cube",
        "scale": 0.001,
        "layer": {"cell": 8.0},
        "material": {"young": 1e4, "poisson": 0.3, "density": 1000.0},
    }
    from_file = Scene({"body": [{**body, "surface": "cube.obj"}]}, folder=tmp_path)
    given: dict[str, Any] = {"body": [{**body, "surface": {"mesh": "cube"}}]}
    from_arrays = Scene(given, surfaces={"cube": (corners, triangles)})
    for scene in (from_file, from_arrays):
        assert scene.bodies == ["cube"] and not scene.has_tool
    fallen = [Simulation(scene) for scene in (from_file, from_arrays)]
    for simulation in fallen:
        report = simulation.run(0.05)[-1]
        assert report.force is None and report.tool is None
    np.testing.assert_array_equal(fallen[0].nodes(), fallen[1].nodes())
    with pytest.raises(InputError, match="columns"):
        Scene(given, surfaces={"cube": (corners[:, :2], triangles)})
    with pytest.raises(InputError, match="whole numbers"):
        Scene(given, surfaces={"cube": (corners, triangles - 1)})


def test_values_by_key() -> None:
    scene = Scene(BLOCK)
    for key in ("body.material.young", "body.block.material.young", "body.0.material.young"):
        softer = scene.with_values({key: np.float64(1e4)})
        assert softer.value(key) == 1e4 and scene.value(key) == 2e4
        assert Simulation(softer).materials()[0].young == 1e4
    assert scene.value("contact.friction") is None
    assert scene.with_values({"contact.friction": 0.4}).value("contact.friction") == 0.4
    with pytest.raises(InputError, match="young"):
        scene.with_values({"body.material.young": -1.0})
    with pytest.raises(InputError, match="no table"):
        scene.with_values({"step.dt.more": 1.0})
    two = {**BLOCK, "body": [BLOCK["body"][0], {**BLOCK["body"][0], "name": "other", "position": [0.2, 0.0, 0.0]}]}
    with pytest.raises(InputError, match="block, other"):
        Scene(two).with_values({"body.material.young": 1e4})


def test_poses_lead_the_tool() -> None:
    simulation = Simulation(Scene(BLOCK))
    trace = simulation.run(0.05, pose=lambda time: (0.0, 0.011 - 0.1 * time, 0.0))
    assert trace[-1].device is not None
    assert trace[-1].device.position == pytest.approx((0.0, 0.006, 0.0))
    assert trace.max_depth[-1] > 0.0 and len(trace) == 25
    turned = Pose((0.0, 0.02, 0.0), (0.0, 2.0, 0.0, 0.0))
    device = simulation.step(turned).device
    assert device is not None and device.orientation == pytest.approx((0.0, 1.0, 0.0, 0.0))
    for wrong in ((0.0, 1.0), (0.0, float("nan"), 0.0), Pose((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))):  # type: ignore[arg-type]
        with pytest.raises(InputError):
            simulation.step(wrong)


def two_tools(**right: object) -> Scene:
    """Two balls on the ground, each a tool; `right`: keys of the second tool."""
    ball = {"surface": {"model": "sphere", "vertices": 100}, "scale": 0.01, "motion": "dynamic", "mass": 0.05}
    coupling = {"stiffness": 500.0, "damping": 5.0, "angular_stiffness": 1.0, "angular_damping": 0.01}
    return Scene(
        {
            "step": {"gravity": [0.0, 0.0, 0.0]},
            "body": [
                {"name": "ground", "plane": [0.0, 1.0, 0.0, 0.0]},
                {"name": "a", "position": [-0.03, 0.0101, 0.0], **ball},
                {"name": "b", "position": [0.03, 0.0101, 0.0], **ball},
            ],
            "tool": [
                {"name": "left", "body": "a", "coupling": coupling},
                {"name": "right", "body": "b", "coupling": coupling, **right},
            ],
        }
    )


def test_haptic_devices_hold_several_tools() -> None:
    drive = {"keys": [[0.0, 0.03, 0.0101, 0.0], [0.1, 0.03, 0.006, 0.0]]}
    simulation = Simulation(two_tools(drive=drive, haptics={"max_force": 3.0}))
    session = simulation.hold(0.4, device="scripted")
    (name,) = session.further
    right = session.further[name]
    assert name == "right" and right.ended is None and right.further == {}
    assert session.steps == right.steps > 10 and right.ticks > 200
    assert session.peak_force < 0.1 < right.peak_force <= 3.0
    assert Simulation(two_tools(drive=drive)).hold(0.1, device="scripted").further == {}


def test_poses_lead_each_of_several_tools() -> None:
    simulation = Simulation(two_tools())
    poses = [Pose((-0.03, 0.008, 0.0)), Pose((0.03, 0.006, 0.0))]
    report = [simulation.step_tools(poses) for _ in range(200)][-1]
    (right,) = report.further_tools
    assert report.force is not None and report.tool is not None and report.device is not None
    for force, tool, device in ((report.force, report.tool, report.device), (right.force, right.tool, right.device)):
        assert force[1] > 0.5
        assert force[1] == pytest.approx(500.0 * (tool.position[1] - device.position[1]), rel=0.01)
    assert right.device.position == (0.03, 0.006, 0.0)
    with pytest.raises(InputError, match="1 poses are given for 2 tools"):
        simulation.step_tools([(0.0, 0.0, 0.0)])


def test_threads_simulate_side_by_side() -> None:
    alone = Simulation(Scene(BLOCK)).run().force
    forces: dict[int, np.ndarray[Any, Any]] = {}

    def simulate(index: int) -> None:
        forces[index] = Simulation(Scene(BLOCK)).run().force

    threads = [threading.Thread(target=simulate, args=(index,)) for index in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(forces) == 4
    for force in forces.values():
        np.testing.assert_array_equal(force, alone)


def test_the_query_finds_an_overlap() -> None:
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float64)
    triangles = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    bodies: list[dict[str, Any]] = [
        {"name": name, "surface": {"mesh": "tetrahedron"}, "scale": 0.1, "motion": "fixed"} for name in "ab"
    ]
    scene = Scene({"body": bodies}, surfaces={"tetrahedron": (corners, triangles)})
    query = palpate.Query(scene, "a", "b")
    apart = query.run((0.0, 0.0, 0.0), (0.2, 0.0, 0.0))
    assert len(apart.vertex) == 0
    close = query.run((0.0, 0.0, 0.0), (0.095, -0.001, -0.001), direction=(1.0, 0.0, 0.0))
    assert len(close.vertex) > 0 and close.depth.max() == pytest.approx(0.005, abs=1e-6)
    np.testing.assert_allclose(close.barycentric.sum(axis=1), 1.0, atol=1e-6)


def test_pictures_show_the_body(pressed: Simulation, tmp_path: Path) -> None:
    picture = pressed.picture(size=(160, 120), show=["pressure", "force"], camera=(30, 20))
    assert picture.shape == (120, 160, 3) and picture.dtype == np.uint8
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 50
    np.testing.assert_array_equal(picture, pressed.picture(size=(160, 120), show=["pressure", "force"], camera=(30, 20)))
    with pytest.raises(InputError, match="pressure"):
        pressed.picture(show=["everything"])


def test_what_meshio_reads_is_a_surface_or_a_layer(tmp_path: Path) -> None:
    corners = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
    squares = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    faces = [(a, b, c) for a, b, c, _ in squares] + [(a, c, d) for a, _, c, d in squares]
    lines = [f"OFF\n8 {len(faces)} 0"] + [" ".join(map(str, corner)) for corner in corners]
    (tmp_path / "cube.off").write_text("\n".join(lines + [f"3 {a} {b} {c}" for a, b, c in faces]))
    cube = palpate.read_mesh(tmp_path / "cube.off")
    assert cube.points.shape == (8, 3) and cube.triangles.shape == (12, 3) and len(cube.tetrahedra) == 0
    a, b, c = (cube.points[cube.triangles[:, k]] for k in range(3))
    assert np.isclose(np.einsum("ij,ij->", a, np.cross(b, c)) / 6, 1.0)
    tables = {"body": [{"name": "cube", "surface": {"mesh": "cube"}, "units": "cm"}]}
    assert palpate.Scene(tables, surfaces={"cube": cube.surface}).bodies == ["cube"]
    (tmp_path / "bad.off").write_text("OFF\n1 1")
    with pytest.raises(palpate.InputError, match="bad.off: meshio cannot read it"):
        palpate.read_mesh(tmp_path / "bad.off")
    (tmp_path / "none.xyz").write_text("0 0 0")
    with pytest.raises(palpate.InputError, match="none.xyz"):
        palpate.read_mesh(tmp_path / "none.xyz")


def test_a_surface_is_prepared_and_filmed(tmp_path: Path) -> None:
    ball = Path(__file__).parents[3] / "docs/tutorials/ball.obj"
    scene = palpate.prepare(ball, tmp_path / "ball", cells=8)
    assert scene.has_tool and len(scene.bodies) == 1
    palpate.film(tmp_path / "ball/scene.toml", tmp_path / "film.png", size=(64, 48), fps=10, seconds=0.1)
    assert (tmp_path / "film.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(InputError, match=r"missing\.obj"):
        palpate.prepare(tmp_path / "missing.obj", tmp_path / "out")


def test_flags_are_those_of_the_engine() -> None:
    from palpate import native

    assert [(flag.value, flag.name) for flag in Flags] == native.flags()


def test_scenes_inside_the_package_are_named() -> None:
    names = palpate.shipped_scenes()
    assert {"touch-head", "touch-human", "lump", "forearm"} <= set(names) and "forearm-bones" not in names
    assert "human" in Scene.load("touch-human").bodies
    with pytest.raises(InputError, match="touch-head"):
        Scene.load("touch-hed")


def test_mistakes_in_a_scene_name_file_line_and_key(tmp_path: Path) -> None:
    file = tmp_path / "wrong.toml"
    file.write_text("[step]\ndt = -1.0\n")
    with pytest.raises(InputError, match=r"wrong\.toml.*dt"):
        Scene.load(file)
    with pytest.raises(InputError, match="cannot be read"):
        Scene.load(tmp_path / "none.toml")
    with pytest.raises(InputError, match="scene"):
        Scene({"bdy": []})
    with pytest.raises(palpate.DeviceError, match="no such thing"):
        Simulation(Scene(BLOCK), device="no such thing")


def test_every_public_name_is_documented() -> None:
    for name in palpate.__all__:
        public = getattr(palpate, name)
        if not inspect.isclass(public) and not inspect.isfunction(public):
            continue
        assert inspect.getdoc(public), name
        for member, value in vars(public).items():
            if not member.startswith("_") and (inspect.isfunction(value) or isinstance(value, property)):
                assert inspect.getdoc(value), f"{name}.{member}"


def test_reactions_carry_the_weight() -> None:
    low = {"box": [[-1.0, -1.0, -1.0], [1.0, 1e-6, 1.0]]}
    block = {
        "name": "block",
        "layer": {"box": [[0.0, 0.0, 0.0], [0.04, 0.04, 0.04]], "cells": [3, 3, 3]},
        "material": {"young": 2e4, "poisson": 0.45, "density": 1000.0, "damping_mass": 30.0},
        "support": [
            {"name": "floor", "plane": [0.0, 1.0, 0.0], "bind": low},
            {"name": "pin", "point": True, "bind": {"nodes": [0]}},
        ],
    }
    simulation = Simulation(Scene({"step": {"dt": 0.01}, "body": [block]}))
    report = simulation.run(1.5)[-1]
    assert list(report.reactions) == ["block.floor", "block.pin"]
    floor, pin = report.reactions.values()
    assert floor.force[0] == floor.force[2] == 0.0
    weight = 1000.0 * 0.04**3 * 9.81
    assert np.allclose(floor.force + pin.force, [0.0, weight, 0.0], atol=1e-5 * weight)
    assert np.allclose(floor.torque + pin.torque, np.cross([0.02, 0.02, 0.02], [0.0, weight, 0.0]), atol=2e-3 * weight)
