"""Tests of sweeps: the same results in one process, in several, and on a cluster whose worker dies."""

import json
import os
import signal
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, cast

import palpate
import pytest
from palpate import InputError, Scene, Simulation, Trace
from palpate.sweep import DaskClient, measured

SCENE = Scene(
    {
        "step": {"dt": 0.005},
        "body": [
            {
                "name": "pad",
                "layer": {"box": [[-0.02, -0.02, -0.02], [0.02, 0.0, 0.02]], "cells": [4, 2, 4]},
                "material": {"young": 2e4, "poisson": 0.4, "density": 1000.0},
                "core": [{"name": "table", "bind": {"box": [[-1.0, -1.0, -1.0], [1.0, -0.019, 1.0]]}}],
            }
        ],
        "tool": {"sphere": 0.01, "mass": 0.05, "position": [0.0, 0.0105, 0.0]},
        "coupling": {"stiffness": 1000.0, "damping": 10.0},
        "drive": {"keys": [[0.0, 0.0, 0.0105, 0.0], [0.05, 0.0, 0.006, 0.0]]},
    }
)
GRID: dict[str, list[Any]] = {
    "body.material.young": [5e3 * 2.0**k for k in range(6)],
    "contact.friction": [0.0, 0.1, 0.3, 0.5],
}


def killed_once(simulation: Simulation, trace: Trace) -> Mapping[str, Any]:
    """Kills its own process at one case, the first time."""
    mark = Path(os.environ["PALPATE_TEST_MARK"])
    if simulation.materials()[0].young > 3e4 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return measured(simulation, trace)


@pytest.fixture(scope="module")
def alone() -> palpate.Sweep:
    """The sweep in this process."""
    return palpate.sweep(SCENE, GRID, workers=1)


def test_a_sweep_has_every_case_in_order(alone: palpate.Sweep) -> None:
    assert len(alone) == 24 and not alone.failed
    assert [row["contact.friction"] for row in alone.rows[:4]] == [0.0, 0.1, 0.3, 0.5]
    forces = [row["peak_force"] for row in alone.rows[::4]]
    assert forces == sorted(forces) and forces[-1] > 3 * forces[0] > 0
    assert alone.rows[0]["flags"] == "{}"


def test_a_cluster_gives_the_same_and_loses_nothing_when_a_worker_dies(
    alone: palpate.Sweep, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    distributed = cast(Any, import_module("distributed"))
    monkeypatch.setenv("PALPATE_TEST_MARK", str(tmp_path / "killed"))
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent))
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        with distributed.Client(cluster) as client:
            dask: DaskClient = client
            together = palpate.sweep(SCENE, GRID, dask, measure=killed_once, out=tmp_path / "out")
    assert (tmp_path / "killed").exists()
    assert together.rows == alone.rows
    table = together.table()
    assert table.num_rows == 24 and table.column("peak_force").to_pylist() == [r["peak_force"] for r in alone.rows]
    together.save(tmp_path / "sweep.parquet")
    assert (tmp_path / "sweep.parquet").read_bytes().startswith(b"PAR1")


def test_processes_of_this_machine_lose_nothing_either(
    alone: palpate.Sweep, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PALPATE_TEST_MARK", str(tmp_path / "killed"))
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent))
    part = {"body.material.young": GRID["body.material.young"]}
    found = palpate.sweep(SCENE, part, measure=killed_once, workers=2)
    assert (tmp_path / "killed").exists() and not found.failed
    assert [row["peak_force"] for row in found.rows] == [row["peak_force"] for row in alone.rows[::4]]


def test_a_sweep_takes_up_where_it_ended(alone: palpate.Sweep, tmp_path: Path) -> None:
    part = {**GRID, "contact.friction": [0.0]}
    first = palpate.sweep(SCENE, part, workers=2, out=tmp_path)
    assert first.rows == alone.rows[::4]
    changed = sorted(tmp_path.glob("case-*.json"))[0]
    row = json.loads(changed.read_text())
    changed.write_text(json.dumps({**row, "peak_force": -1.0}))
    again = palpate.sweep(SCENE, part, workers=1, out=tmp_path)
    assert [row["peak_force"] == -1.0 for row in again.rows].count(True) == 1
    with pytest.raises(InputError, match="another scene"):
        palpate.sweep(SCENE.with_values({"step.dt": 0.004}), part, out=tmp_path)


def test_failures_are_kept_with_their_reason() -> None:
    found = palpate.sweep(SCENE, [{"body.material.young": -1.0}, {"body.material.young": 1e4}], workers=1)
    assert found.rows[1]["error"] is None and found.failed == [found.rows[0]]
    assert "young" in found.failed[0]["error"] and found.table().num_rows == 2
    with pytest.raises(InputError, match="list of values"):
        grid: Any = {"contact.friction": 0.3}
        palpate.sweep(SCENE, grid, workers=1)
    with pytest.raises(InputError, match="no table"):
        palpate.sweep(SCENE, {"step.dt.more": [1.0]}, workers=1)


def test_scenes_travel(tmp_path: Path) -> None:
    import pickle

    load: Callable[[bytes], Scene] = pickle.loads
    other = load(pickle.dumps(SCENE))
    assert other.tables == SCENE.tables and other.fingerprint == SCENE.fingerprint
