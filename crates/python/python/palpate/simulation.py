"""Simulations of scenes, step by step."""

import json
import operator
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, SupportsIndex, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import native
from .context import Context
from .errors import InputError
from .flags import Flags
from .plain import Floats, Indices, PlainPose, PlainTool, ReadPose, Report, Tick
from .scene import Scene


class Pose(NamedTuple):
    """A position and an orientation in the world."""

    position: tuple[float, float, float]
    """Position, m."""
    orientation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    """Rotation from the object's axes to the world's, a quaternion x y z w."""


PoseLike: TypeAlias = Pose | Sequence[float] | NDArray[np.floating]
"""A :class:`Pose`, or three numbers: a position (m) without rotation."""


class Work(NamedTuple):
    """What a step asked of the GPU."""

    solves: int
    """Linear solves, and one more for each time that contacts under tension were released."""
    submits: int
    """Submits to the GPU; the CPU waits for the end of each."""
    planned_iterations: int
    """Solver iterations that were submitted."""
    dependent_passes: int
    """Passes that had to wait for an earlier one."""


class Reaction(NamedTuple):
    """Force and torque by which a support, or a fixed or driven core, acts on its body."""

    force: Floats
    """Force, world axes, N, shape (3,)."""
    torque: Floats
    """Torque about the world's origin, N m, shape (3,)."""


class ToolReport(NamedTuple):
    """A tool after the first of several, at the end of a step."""

    force: Floats
    """Contact force on the tool, world axes, N, shape (3,)."""
    torque: Floats
    """Contact torque on the tool about its centre, world axes, N m, shape (3,)."""
    tool: Pose
    """Pose of the tool."""
    device: Pose
    """Pose of its haptic device."""


@dataclass(frozen=True, slots=True)
class StepReport:
    """What a step did, and the state at its end. With several tools, ``force``, ``torque``, ``tool`` and ``device`` are
    those of the first."""

    step: int
    """Number of steps done, this one included."""
    time: float
    """Simulated time at the end of the step, s."""
    force: Floats | None
    """Contact force on the tool, world axes, N, shape (3,); ``None`` without a tool."""
    torque: Floats | None
    """Contact torque on the tool about its centre, world axes, N m, shape (3,); ``None`` without a tool."""
    tool: Pose | None
    """Pose of the tool; ``None`` without a tool."""
    device: Pose | None
    """Pose of the haptic device; ``None`` without a tool."""
    further_tools: tuple[ToolReport, ...]
    """The tools after the first, in the scene's order."""
    contact_count: int | None
    """Number of contacts, which are skin vertices or triangles in another body; ``None`` where nothing can collide."""
    max_depth: float | None
    """Greatest depth of a contact, m; ``None`` where nothing can collide."""
    iterations: int
    """Conjugate gradient iterations, summed over all linear solves of the step."""
    residual: float
    """Relative residual of the linear system at the end of the last solve."""
    flags: Flags
    """What went wrong in the step; 0 if nothing did."""
    step_us: float
    """Wall time of the step, microseconds."""
    probes: Floats
    """World positions of the scene's probes, m, shape (P, 3)."""
    reactions: dict[str, Reaction]
    """What holds the bodies: of each fixed or driven core, and each support, of the bodies that report reactions, by
    ``"BODY.NAME"``."""
    work: Work
    """What the step asked of the GPU."""


class Sample(NamedTuple):
    """The haptic loop as it was at one of its ticks (iterations), of several tools that of the first."""

    time: float
    """Time since the loop began, s."""
    device: Pose
    """Pose of the haptic device."""
    tool: Pose
    """Pose of the tool."""
    force: Floats
    """Force played to the hand, N, shape (3,)."""
    torque: Floats
    """Torque played to the hand, N m, shape (3,)."""
    contact_force: Floats
    """Contact force on the tool, N, shape (3,)."""
    age: float
    """Time since the inputs of the newest step were taken, s."""


class Session(NamedTuple):
    """What a run of the haptic loop was like: that of the first tool, which has those of others in ``further``."""

    ticks: int
    """Number of ticks (iterations of the loop)."""
    steps: int
    """Number of simulation steps meanwhile."""
    pace: float
    """Simulated time over elapsed time; below 1, bodies moved more slowly than in reality."""
    peak_force: float
    """Greatest force played, N."""
    ended: str | None
    """Why it ended early; ``None`` if it did not."""
    notes: list[str]
    """What a user should know, a sentence each."""
    summary: dict[str, Any]
    """All of it with lateness, energy and events, as ``haptics`` in ``summary.json``; names have units."""
    further: dict[str, "Session"]
    """By name of the tool: the loops of the tools after the first that have a haptic device."""


class Contacts(NamedTuple):
    """The contacts of a step by columns: N skin vertices, or parts of triangles, that lie inside another body."""

    bodies: Indices
    """The body that the vertex or triangle belongs to, and the body that it touches, by index, shape (N, 2); the tool's
    index is the one after the last body's."""
    vertex: Indices
    """Index of the vertex in the skin of its body, shape (N,); of a triangle, the corner nearest to its centre of
    pressure."""
    position: Floats
    """World position of the vertex, or of the triangle's centre of pressure, m, shape (N, 3)."""
    normal: Floats
    """Unit normal out of the touched body, world axes, shape (N, 3)."""
    depth: Floats
    """Depth of the vertex along the normal, m, shape (N,); of a triangle, the mean over its part."""
    area: Floats
    """Area of skin that the vertex stands for, or of the triangle's part, projected along the normal, m^2, shape (N,)."""
    pressure: Floats
    """Pressure along the normal at the end of the step, Pa, shape (N,)."""
    friction: Floats
    """Friction force per area on the body of the vertex or triangle, world axes, Pa, shape (N, 3)."""

    @property
    def force(self) -> Floats:
        """Force on the body of the vertex or triangle, world axes, N, shape (N, 3)."""
        return self.area[:, None] * (self.pressure[:, None] * self.normal + self.friction)


class Skin(NamedTuple):
    """A skin (surface mesh) of N vertices and M triangles.

    Positions and normals are views of memory that :meth:`Simulation.skin` writes: the next call of that method, for any
    body of the simulation, changes them. Copy what is to be kept.
    """

    positions: NDArray[np.float32]
    """World positions of the vertices, m, shape (N, 3)."""
    normals: NDArray[np.float32]
    """Outward unit normals, shape (N, 3)."""


class Material(NamedTuple):
    """Elastic material; the law (corotational or neo-Hookean) is the scene's."""

    young: float
    """Young's modulus at small strain, Pa."""
    poisson: float
    """Poisson's ratio at small strain."""
    density: float
    """Density, kg/m^3."""
    damping_mass: float = 0.0
    """Rayleigh damping coefficient that multiplies the mass matrix, 1/s."""
    damping_stiffness: float = 0.0
    """Rayleigh damping coefficient that multiplies the stiffness matrix, s."""


@dataclass
class Trace:
    """The reports of several steps by columns; T is the number of steps."""

    reports: list[StepReport] = field(default_factory=list["StepReport"])
    """The reports of the steps."""

    def __len__(self) -> int:
        return len(self.reports)

    def __iter__(self) -> Iterator[StepReport]:
        return iter(self.reports)

    def __getitem__(self, step: int) -> StepReport:
        return self.reports[step]

    @property
    def time(self) -> Floats:
        """Simulated time at the end of each step, s, shape (T,)."""
        return np.array([report.time for report in self.reports])

    @property
    def force(self) -> Floats:
        """Contact force on the tool (of several the first), world axes, N, shape (T, 3); NaN without a tool."""
        return _rows([report.force for report in self.reports])

    @property
    def torque(self) -> Floats:
        """Contact torque on that tool about its centre, world axes, N m, shape (T, 3); NaN without a tool."""
        return _rows([report.torque for report in self.reports])

    @property
    def tool(self) -> Floats:
        """Position of that tool, m, shape (T, 3); NaN without a tool."""
        return _rows([report.tool and np.array(report.tool.position) for report in self.reports])

    @property
    def device(self) -> Floats:
        """Position of its haptic device, m, shape (T, 3); NaN without a tool."""
        return _rows([report.device and np.array(report.device.position) for report in self.reports])

    @property
    def max_depth(self) -> Floats:
        """Greatest depth of a contact, m, shape (T,); NaN where nothing can collide."""
        return np.array([np.nan if report.max_depth is None else report.max_depth for report in self.reports])

    @property
    def iterations(self) -> NDArray[np.int64]:
        """Conjugate gradient iterations of each step, shape (T,)."""
        return np.array([report.iterations for report in self.reports], np.int64)

    @property
    def flags(self) -> Flags:
        """The flags of all steps together."""
        together = Flags(0)
        for report in self.reports:
            together |= report.flags
        return together

    def flagged(self) -> dict[str, int]:
        """Number of steps that raised each flag, by the flag's name."""
        counts = {flag.name or "": sum(flag in report.flags for report in self.reports) for flag in Flags}
        return {name: count for name, count in counts.items() if count > 0}


class Simulation:
    """A scene that is being simulated on a Vulkan device.

    Calls from several threads follow one another, and none holds the interpreter's lock while the device works, so that
    simulations in several threads run side by side.

    Args:
        scene: The scene, or what :meth:`Scene.load` takes.
        context: A device that is open already; ``None``: the simulation opens one of its own.
        device: Part of the name, or the index, of the device to open; ``None``: the first usable one.
        threads: Worker threads of Mesa's CPU driver lavapipe: a number, ``"auto"`` (none for small scenes, which are
            faster so) or ``None`` (the driver's choice). Set by an environment variable of the process.
        cache: Whether prepared bodies are kept in the user's cache folder, which saves seconds the next time.

    Raises:
        InputError: The scene cannot be used.
        DeviceError: No Vulkan device can be used; the message says what to install.
        OutOfMemoryError: The device has too little memory for the scene.
    """

    def __init__(
        self,
        scene: Scene | str | os.PathLike[str],
        *,
        context: Context | None = None,
        device: str | int | None = None,
        threads: int | str | None = "auto",
        cache: bool = True,
    ) -> None:
        if context is not None and device is not None:
            raise InputError("both a context and a device are given; give one of them")
        self.scene = scene if isinstance(scene, Scene) else Scene.load(scene)
        self._native = native.Simulation(
            self.scene._native,  # pyright: ignore[reportPrivateUsage]
            context and context._native,  # pyright: ignore[reportPrivateUsage]
            None if device is None else str(device),
            None if threads is None else str(threads),
            cache,
        )

    def step(self, pose: PoseLike | None = None) -> StepReport:
        """Simulate one step of the scene's ``dt``.

        Args:
            pose: Pose of the haptic device at the end of the step: a :class:`Pose`, or a position (m). The device moves
                there uniformly. ``None``: it follows the scene's ``[drive]``, or stays where an earlier pose put it.
        """
        return _report(self._native.step(None if pose is None else _pose(pose)))

    def step_tools(self, poses: Sequence[PoseLike]) -> StepReport:
        """Simulate one step of the scene's ``dt``, and lead the haptic device of each of several tools.

        Args:
            poses: Poses of the devices at the end of the step, one for each tool in the scene's order: as of
                :meth:`step`, which leads that of the first tool alone.

        Raises:
            InputError: The number of poses is not that of the tools.
        """
        return _report(self._native.step_tools([_pose(pose) for pose in poses]))

    def run(
        self,
        seconds: float | None = None,
        *,
        pose: Callable[[float], PoseLike] | None = None,
        progress: bool = False,
    ) -> Trace:
        """Simulate for some time, and return the reports of all steps.

        Args:
            seconds: Time to simulate, s. ``None``: up to the last key of the scene's trajectories.
            pose: Called with the time at the end of each step (s); returns the pose of the haptic device then. ``None``:
                the device follows the scene's ``[drive]``.
            progress: Whether to show on standard error how far the run is.
        """
        dt, begun = self.scene.dt, self.time
        duration = max(self.scene.duration - begun, 0.0) if seconds is None else seconds
        if not 0.0 <= duration < float("inf"):
            raise InputError(f"seconds is {seconds}; give a time of 0 or more")
        count, trace = round(duration / dt), Trace()
        for step in range(count):
            trace.reports.append(self.step(None if pose is None else pose(begun + (step + 1) * dt)))
            if progress and (step % max(count // 100, 1) == 0 or step + 1 == count):
                end = "\n" if step + 1 == count else ""
                print(f"\r{self.scene.name}: {100 * (step + 1) // count} %", end=end, file=sys.stderr, flush=True)
        return trace

    def hold(
        self,
        seconds: float,
        *,
        device: str | None = None,
        watch: Callable[[Sample], object] | None = None,
        every: float = 0.02,
    ) -> Session:
        """Let a haptic device hold the tool: run the haptic loop in real time, at the rate of the scene's ``[haptics]``.

        Of several tools each to which the scene gives ``haptics`` has a device and a loop of its own.

        Loop and simulation run outside the interpreter, which cannot delay a force. Called on the main thread, Ctrl-C
        ends the loop and releases the device.

        Args:
            seconds: Duration, s.
            device: ``"scripted"`` (follows the scene's ``[drive]``), ``"hand"`` (a simulated hand), ``"haply"``,
                ``"touch"``, ``"force-dimension"``, ``"space-mouse"``, ``"game-pad"``, ``"openxr"`` or ``"replay"``;
                ``None``: the scene's. It is that of the first tool.
            watch: Called on this thread with the newest :class:`Sample`. If it returns ``False``, the loop ends; if it
                raises, too, and the error comes out of this call. It may not call the simulation.
            every: Time between two calls of ``watch``, s.

        Raises:
            InputError: The scene has no tool, or there is no such device.
            DeviceError: The device cannot be opened.
        """
        if not (0.0 < seconds < float("inf") and 0.0 < every < float("inf")):
            raise InputError(f"seconds is {seconds}, every is {every}; give finite times above 0")

        def show(tick: Tick) -> object:
            return None if watch is None else watch(_sample(tick))

        told = self._native.hold(seconds, device, every, None if watch is None else show)
        further: dict[str, Session] = {}
        for tool, ticks, steps, pace, peak_force, ended, notes, summary in told[1:]:
            further[tool] = Session(ticks, steps, pace, peak_force, ended, notes, json.loads(summary), {})
        _, ticks, steps, pace, peak_force, ended, notes, summary = told[0]
        return Session(ticks, steps, pace, peak_force, ended, notes, json.loads(summary), further)

    @property
    def time(self) -> float:
        """Simulated time at the end of the last step, s."""
        return self._native.time

    @property
    def device(self) -> str:
        """Name of the Vulkan device."""
        return self._native.device

    @property
    def bodies(self) -> list[str]:
        """Names of the bodies, in the order of the scene; methods take a name or an index."""
        return self._native.bodies

    @property
    def notes(self) -> list[str]:
        """Values that are most likely a mistake, and what preparation changed in mesh files, a sentence each."""
        return self._native.notes()

    def contacts(self) -> Contacts:
        """The contacts of the last step, without those that would have pulled and were released."""
        return Contacts(*self._native.contacts())

    def nodes(self, body: str | SupportsIndex = 0) -> Floats:
        """World positions of the nodes of a soft body's tetrahedral mesh, m, shape (N, 3); empty for another body."""
        return self._native.nodes(self._body(body))[0]

    def node_velocities(self, body: str | SupportsIndex = 0) -> Floats:
        """Velocities of the nodes of a soft body, world axes, m/s, shape (N, 3); empty for another body."""
        return self._native.nodes(self._body(body))[1]

    def stress(self, body: str | SupportsIndex = 0) -> Floats:
        """Cauchy's stress in each tetrahedron of a soft body after the last step, Pa, world axes, shape (M, 3, 3); empty
        for another body. It is that of the material's law, with the penalty on compression below a stretch of 0.3,
        without damping. It is zero in a tetrahedron that is flat or inside out."""
        return self._native.stress(self._body(body))

    def strain_energy_density(self, body: str | SupportsIndex = 0) -> Floats:
        """Strain energy density in each tetrahedron of a soft body after the last step, J per m^3 at rest, shape (M,);
        empty for another body."""
        return self._native.strain_energy_density(self._body(body))

    def contact_forces(self, body: str | SupportsIndex = 0) -> Floats:
        """Force of the last step's contacts on each vertex of a body's skin, N, world axes, shape (N, 3); ``"tool"`` is
        the tool. Where triangles are tested for contact, the force on the rigid body that they meet is at no vertex of
        its own and is left out."""
        return self._native.contact_forces(self._body(body))

    def tetrahedra(self, body: str | SupportsIndex = 0) -> Indices:
        """Nodes of each tetrahedron of a soft body, shape (M, 4); empty for another body."""
        return self._native.tetrahedra(self._body(body))

    def skin(self, body: str | SupportsIndex = 0) -> Skin:
        """The skin of a body as it is now; ``"tool"`` is the tool's. See :class:`Skin` on how long it stays so."""
        positions, normals = self._native.skin(self._body(body))
        return Skin(positions[:, :3], normals[:, :3])

    def triangles(self, body: str | SupportsIndex = 0) -> Indices:
        """Vertices of each triangle of a body's skin, counter-clockwise seen from outside, shape (M, 3)."""
        return self._native.triangles(self._body(body))

    def save(self) -> bytes:
        """The state after the last step, from which :meth:`restore` continues to the last bit on the same device."""
        return self._native.save()

    def restore(self, state: bytes) -> None:
        """Continue from a saved state.

        Raises:
            InputError: The state is damaged or belongs to a simulation of other bodies; nothing is changed.
        """
        self._native.restore(state)

    def materials(self, body: str | SupportsIndex = 0) -> list[Material]:
        """The materials of a body: its own, then those of its material regions; empty where it is not soft."""
        return [Material(*values) for values in self._native.materials(self._body(body))]

    def set_material(self, material: Material, body: str | SupportsIndex = 0, index: int = 0) -> None:
        """Give a soft body another material from the next step on.

        Args:
            material: The new material.
            body: Name or index of the body.
            index: Which of :meth:`materials` it replaces.
        """
        if not 0 <= index < len(self.materials(body)):
            raise InputError(f"the body has no material {index}; give an index below {len(self.materials(body))}")
        self._native.set_material(self._body(body), index, [float(value) for value in material])

    def set_contact(
        self,
        *,
        stiffness: float | None = None,
        damping: float | None = None,
        friction: float | None = None,
        depth_limit: float | None = None,
    ) -> None:
        """Change the contact law from the next step on; ``None`` keeps a value.

        Args:
            stiffness: Penalty stiffness per contact area, N/m^3.
            damping: Penalty damping per contact area, N s/m^3.
            friction: Coulomb's coefficient of friction.
            depth_limit: Depth of a contact above which a step raises a flag, m.
        """
        self._native.set_contact(stiffness, damping, friction, depth_limit)

    def set_coupling(
        self,
        stiffness: float,
        damping: float = 0.0,
        angular_stiffness: float = 0.0,
        angular_damping: float = 0.0,
    ) -> None:
        """Set the virtual coupling, a spring and damper between haptic device and tool, of several tools the first.

        Args:
            stiffness: Force per distance, N/m.
            damping: Force per velocity, N s/m.
            angular_stiffness: Torque per angle, N m/rad.
            angular_damping: Torque per angular velocity, N m s/rad.
        """
        self._native.set_coupling([stiffness, damping, angular_stiffness, angular_damping])

    def core_pose(self, body: str | SupportsIndex, core: int = 0) -> Pose | None:
        """Pose of a body's rigid core; ``None`` if there is no such core."""
        pose = self._native.core_pose(self._body(body), core)
        return pose and _plain_pose(pose)

    def move_core(self, pose: PoseLike, body: str | SupportsIndex = 0, core: int = 0, seconds: float = 0.0) -> None:
        """Move a driven core to a pose, uniformly within some seconds (a step at least), and leave it there."""
        self._native.move_core(self._body(body), core, _pose(pose), seconds)

    def picture(
        self,
        *,
        size: tuple[int, int] = (1280, 720),
        show: Sequence[str] = (),
        camera: tuple[float, float] | tuple[float, float, float] | None = None,
        at: Sequence[float] | None = None,
        time: bool = True,
    ) -> NDArray[np.uint8]:
        """An image of the simulation as it is now, shape (height, width, 3), red, green and blue from 0 to 255.

        Args:
            size: Width and height, pixels.
            show: What to show besides the skins: one of ``pressure``, ``depth``, ``energy``, ``displacement``,
                ``materials``; and ``force``, ``proxies``, ``regions``, ``layer``, ``cores``.
            camera: Angles to the right of the front and above the horizon (degrees), and a zoom factor.
            at: Point that the camera looks at, m.
            time: Whether the simulated time stands in a corner.
        """
        words = ["--size", f"{size[0]}x{size[1]}"]
        words += ["--show", ",".join(show)] if show else []
        words += [f"--camera={','.join(map(str, camera))}"] if camera is not None else []
        words += [f"--at={','.join(str(float(x)) for x in at)}"] if at is not None else []
        words += [] if time else ["--no-time"]
        return self._native.picture(words)

    def _body(self, body: str | SupportsIndex) -> int:
        names = [*self.bodies, "tool"] if self.scene.has_tool else self.bodies
        if isinstance(body, str):
            if body in names:
                return names.index(body)
        elif 0 <= operator.index(body) < len(names):
            return operator.index(body)
        raise InputError(f"there is no body {body!r}; give one of {', '.join(names)}, or an index below {len(names)}")

    def __repr__(self) -> str:
        return f"Simulation({self.scene.name!r}, time={self.time:.4g} s, device={self.device!r})"


def _pose(pose: "PoseLike | ArrayLike") -> PlainPose:
    position, orientation = pose if isinstance(pose, Pose) else (pose, Pose((0.0, 0.0, 0.0)).orientation)
    try:
        x, y, z = (float(number) for number in np.asarray(position, np.float64))
        i, j, k, w = (float(number) for number in np.asarray(orientation, np.float64))
    except (TypeError, ValueError):
        raise InputError(f"{pose!r} is no pose; give three numbers, or a Pose of three and four numbers") from None
    return (x, y, z), (i, j, k, w)


def _plain_pose(pose: ReadPose) -> Pose:
    position, orientation = pose
    return Pose(
        cast(tuple[float, float, float], tuple(position)),
        cast(tuple[float, float, float, float], tuple(orientation)),
    )


def _sample(tick: Tick) -> Sample:
    time, device, tool, force, torque, contact, age = tick
    poses = _plain_pose(device), _plain_pose(tool)
    return Sample(time, *poses, np.array(force), np.array(torque), np.array(contact), age)


def _tool_report(plain: PlainTool) -> ToolReport:
    force, torque, tool, device = plain
    return ToolReport(np.array(force), np.array(torque), _plain_pose(tool), _plain_pose(device))


def _report(plain: Report) -> StepReport:
    step, time, tools, contacts, depth, iterations, residual, flags, step_us, probes, reactions, work = plain
    reports = [_tool_report(tool) for tool in tools]
    first = reports[0] if reports else None
    return StepReport(
        step=step,
        time=time,
        force=first and first.force,
        torque=first and first.torque,
        tool=first and first.tool,
        device=first and first.device,
        further_tools=tuple(reports[1:]),
        contact_count=contacts,
        max_depth=depth,
        iterations=iterations,
        residual=residual,
        flags=Flags(flags),
        step_us=step_us,
        probes=np.array(probes).reshape(-1, 3),
        reactions={name: Reaction(np.array(force), np.array(torque)) for name, force, torque in reactions},
        work=Work(*work),
    )


def _rows(vectors: Sequence[Floats | None]) -> Floats:
    return np.array([np.full(3, np.nan) if vector is None else vector for vector in vectors]).reshape(-1, 3)
