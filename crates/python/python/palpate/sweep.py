"""Many simulations of one scene with other values: on a cluster, on the cores of one machine, or one after another."""

import hashlib
import itertools
import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ProcessPoolExecutor, as_completed, wait
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Protocol, TypeAlias, cast

import numpy as np

from .context import Context
from .errors import InputError, SimulationError
from .native import __version__
from .scene import Scene, plain_value
from .simulation import Simulation, Trace

Values: TypeAlias = dict[str, Any]
"""Values by dotted key, as :meth:`Scene.with_values` takes them."""
Row: TypeAlias = dict[str, Any]
"""Values of a case by key, results by name, and ``error``: why the case failed, or ``None``."""
ATTEMPTS = 3
"""How often a case is tried alone whose worker died."""
Measure: TypeAlias = Callable[[Simulation, Trace], Mapping[str, Any]]
Job: TypeAlias = tuple[Scene, Values, float | None, Measure]


class DaskClient(Protocol):
    """What a sweep needs of ``dask.distributed.Client``."""

    def submit(self, func: Callable[..., Any], *args: Any, pure: bool) -> Any:
        """Run a function on a worker."""
        ...


def measured(simulation: Simulation, trace: Trace) -> Row:
    """What a sweep keeps of a case by default: greatest force (N) and its time (s), greatest depth of a contact (m), the
    force at the end (N), mean iterations of a step, and the steps that raised each flag."""
    force = np.linalg.norm(trace.force, axis=1)
    is_felt = len(force) > 0 and bool(np.isfinite(force).all())
    return {
        "peak_force": float(force.max()) if is_felt else None,
        "peak_time": float(trace.time[force.argmax()]) if is_felt else None,
        "last_force": float(force[-1]) if is_felt else None,
        "max_depth": float(np.nanmax(trace.max_depth, initial=0.0)),
        "iterations": float(trace.iterations.mean()) if len(trace) else 0.0,
        "flags": json.dumps(trace.flagged()),
    }


@dataclass(frozen=True)
class Sweep:
    """Results of a sweep, a row for each case in the order of the grid."""

    rows: list[Row]
    """Values by key, results by name, and ``error`` of each case."""

    @property
    def failed(self) -> list[Row]:
        """The cases that failed, each with its reason in ``error``."""
        return [row for row in self.rows if row["error"] is not None]

    def table(self) -> Any:
        """The rows as a ``pyarrow.Table``; needs the package pyarrow."""
        names = dict.fromkeys(name for row in self.rows for name in row)
        return _arrow("pyarrow").table({name: [row.get(name) for row in self.rows] for name in names})

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the rows as a Parquet file, which needs the package pyarrow."""
        _arrow("pyarrow.parquet").write_table(self.table(), os.fspath(file))

    def __len__(self) -> int:
        return len(self.rows)


def _arrow(module: str) -> Any:
    try:
        return import_module(module)
    except ImportError:
        raise InputError("a table needs the package pyarrow; pip install pyarrow") from None


def grid_cases(grid: Mapping[str, Iterable[Any]] | Iterable[Mapping[str, Any]]) -> list[Values]:
    """The cases of a grid: every combination of the values of each key, the last key fastest; or the cases themselves."""
    if isinstance(grid, Mapping):
        keys = [str(key) for key in grid]
        for key, values in cast(Mapping[str, Any], grid).items():
            if isinstance(values, str) or not isinstance(values, Iterable):
                raise InputError(f"{key}: the grid has {values!r}; give a list of values")
        combinations = itertools.product(*(list(values) for values in cast(Mapping[str, Iterable[Any]], grid).values()))
        cases: list[Values] = [dict(zip(keys, values, strict=True)) for values in combinations]
    else:
        cases = [dict(case) for case in grid]
    return [cast(Values, plain_value(case)) for case in cases]


def sweep(
    scene: Scene,
    grid: Mapping[str, Iterable[Any]] | Iterable[Mapping[str, Any]],
    client: DaskClient | Executor | None = None,
    *,
    seconds: float | None = None,
    measure: Measure = measured,
    workers: int | None = None,
    out: str | os.PathLike[str] | None = None,
    progress: bool = False,
) -> Sweep:
    """Simulate a scene once for each case of a grid.

    A case that fails does not end the sweep: its row says why. With ``out`` each result is written as soon as it is known,
    and a sweep that is called again takes up where it ended.

    Args:
        scene: The scene.
        grid: Values by dotted key, of which every combination is a case; or a list of cases.
        client: A ``dask.distributed.Client``, or an executor of ``concurrent.futures``, whose workers have this package.
            ``None``: processes of this machine.
        seconds: Time to simulate, s; ``None``: up to the last key of the scene's trajectories.
        measure: Called with each simulation and its trace; returns results by name, numbers and texts. Workers must be able
            to import it.
        workers: Number of processes where there is no client; ``None``: one for each two cores. 1: in this process.
        out: Folder of the results, one file for each case.
        progress: Whether to show on standard error how many cases are done.

    Raises:
        InputError: A key of the grid leads nowhere, or ``out`` belongs to another sweep.
    """
    cases = grid_cases(grid)
    for key in dict.fromkeys(key for case in cases for key in case):
        scene.value(key)
    store = None if out is None else _Store(Path(out), scene, seconds, measure)
    known = {} if store is None else store.known(cases)
    missing = [index for index in range(len(cases)) if index not in known]
    for index, row in _run(scene, cases, missing, client, seconds, measure, workers):
        # A case whose worker failed, and not its simulation, is tried again by the next sweep.
        if isinstance(row, Exception):
            known[index] = {**cases[index], "error": f"{type(row).__name__}: {row}"}
            continue
        known[index] = row
        if store is not None:
            store.keep(cases[index], row)
        if progress:
            print(f"\r{len(known)} of {len(cases)} cases", end="", file=sys.stderr, flush=True)
    if progress:
        print(file=sys.stderr)
    return Sweep([known[index] for index in range(len(cases))])


def _run(
    scene: Scene,
    cases: Sequence[Values],
    missing: Sequence[int],
    client: DaskClient | Executor | None,
    seconds: float | None,
    measure: Measure,
    workers: int | None,
) -> Iterator[tuple[int, Row | Exception]]:
    """Index and row of each missing case, as they end, or why its worker failed."""
    jobs = {index: (scene, cases[index], seconds, measure) for index in missing}
    count = workers if workers is not None else max((os.cpu_count() or 2) // 2, 1)
    if client is None and count <= 1:
        for index, job in jobs.items():
            try:
                yield index, run_case(*job)
            except Exception as error:  # noqa: BLE001  the reason is kept
                yield index, error
    elif client is None:
        yield from _in_processes(jobs, count)
    elif isinstance(client, Executor):
        futures = {client.submit(run_case, *job): index for index, job in jobs.items()}
        for future in as_completed(futures):
            yield futures[future], _row(future)
    else:
        # Dask itself gives the case of a worker that died to another one, as often as its configuration says.
        submitted = {client.submit(run_case, *job, pure=False): index for index, job in jobs.items()}
        for future in import_module("distributed").as_completed(list(submitted)):
            yield submitted[future], _row(future)


def _in_processes(jobs: Mapping[int, Job], count: int) -> Iterator[tuple[int, Row | Exception]]:
    """Run cases in processes of this machine. When one of them dies, the cases that were running are tried alone."""
    waiting = list(jobs)
    while waiting:
        suspects: list[int] = []
        with _pool(count) as pool:
            running: dict[Future[Row], int] = {}
            while (waiting or running) and not suspects:
                while waiting and len(running) < count:
                    index = waiting.pop(0)
                    running[pool.submit(run_case, *jobs[index])] = index
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    index, row = running.pop(future), _row(future)
                    if isinstance(row, BrokenExecutor):
                        suspects = [index, *running.values()]
                        break
                    yield index, row
        for index in suspects:
            row: Row | Exception = RuntimeError("never run")
            for _ in range(ATTEMPTS):
                with _pool(1) as pool:
                    row = _row(pool.submit(run_case, *jobs[index]))
                if not isinstance(row, BrokenExecutor):
                    break
            yield index, row


def _pool(count: int) -> ProcessPoolExecutor:
    """Processes that start anew: forked ones would share the state of a Vulkan driver."""
    return ProcessPoolExecutor(count, mp_context=get_context("spawn"))


def run_case(scene: Scene, values: Values, seconds: float | None, measure: Measure) -> Row:
    """Simulate one case of a sweep; a failure of the engine is a row with its reason."""
    try:
        simulation = Simulation(scene.with_values(values), context=_device())
        trace = simulation.run(seconds)
    except (InputError, SimulationError) as error:
        return {**values, "error": f"{type(error).__name__}: {error}"}
    row = cast(Row, plain_value({**values, **measure(simulation, trace), "error": None}))
    json.dumps(row)  # what cannot be kept is an error here, and not when all is done
    return row


@cache
def _device() -> Context:
    """The device of all cases in this process. Of lavapipe's threads there is but the calling one, since each process has
    its case."""
    return Context(threads=0)


def _row(future: "Future[Row] | Any") -> Row | Exception:
    """The row of a case that ended, or why its worker failed."""
    try:
        return cast(Row, future.result())
    except Exception as error:  # noqa: BLE001  failures of the case itself are rows
        return error


class _Store:
    """A folder with a file for each case."""

    def __init__(self, folder: Path, scene: Scene, seconds: float | None, measure: Measure) -> None:
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        name = f"{measure.__module__}.{measure.__qualname__}"
        about = {"scene": scene.fingerprint, "seconds": seconds, "measure": name, "version": __version__}
        mark = json.dumps(about, sort_keys=True)
        file = folder / "sweep.json"
        if not file.exists():
            _write(file, mark)
        elif file.read_text(encoding="utf-8") != mark:
            problem = "holds the results of another scene, duration, measure or version"
            raise InputError(f"{folder}: {problem}; give another folder")

    def known(self, cases: Sequence[Values]) -> dict[int, Row]:
        """The rows of the cases that are done."""
        files = ((index, self._file(case)) for index, case in enumerate(cases))
        return {index: json.loads(file.read_text(encoding="utf-8")) for index, file in files if file.exists()}

    def keep(self, case: Values, row: Row) -> None:
        """Write a row."""
        _write(self._file(case), json.dumps(row))

    def _file(self, case: Values) -> Path:
        digest = hashlib.sha256(json.dumps(case, sort_keys=True).encode()).hexdigest()
        return self.folder / f"case-{digest[:24]}.json"


def _write(file: Path, text: str) -> None:
    """Write a whole file, or none."""
    hidden = file.with_name(f".{file.name}.{os.getpid()}")
    hidden.write_text(text, encoding="utf-8")
    hidden.replace(file)
