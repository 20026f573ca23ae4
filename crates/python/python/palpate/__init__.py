"""Feel soft bodies: deformable contact and haptic forces on any Vulkan 1.3 device.

A :class:`Scene` says what is simulated, a :class:`Simulation` advances it step by step. Units are SI, axes are
right-handed, quaternions are in the order x y z w.

    >>> import palpate
    >>> simulation = palpate.Simulation("touch-head")
    >>> trace = simulation.run(0.1)
    >>> trace.force.shape
    (100, 3)
"""

from .context import Context, Device, devices
from .errors import (
    DeviceError,
    InputError,
    OutOfMemoryError,
    OutputError,
    PalpateError,
    SimulationError,
    VulkanError,
)
from .flags import Flags
from .identify import Estimate, Fit, fit
from .mesh_file import MeshFile, read_mesh
from .native import __version__
from .plain import Floats, Indices
from .program import film, prepare
from .query import Overlap, Query
from .scene import Scene, shipped_scenes
from .simulation import (
    Contacts,
    Material,
    Pose,
    PoseLike,
    Reaction,
    Sample,
    Session,
    Simulation,
    Skin,
    StepReport,
    ToolReport,
    Trace,
    Work,
)
from .sweep import Sweep, sweep
from .usd import UsdStage

__all__ = [
    "Contacts",
    "Context",
    "Device",
    "DeviceError",
    "Estimate",
    "Fit",
    "Flags",
    "Floats",
    "Indices",
    "InputError",
    "Material",
    "MeshFile",
    "OutOfMemoryError",
    "OutputError",
    "Overlap",
    "PalpateError",
    "Pose",
    "PoseLike",
    "Query",
    "Reaction",
    "Sample",
    "Scene",
    "Session",
    "Simulation",
    "SimulationError",
    "Skin",
    "StepReport",
    "Sweep",
    "ToolReport",
    "Trace",
    "UsdStage",
    "VulkanError",
    "Work",
    "__version__",
    "devices",
    "film",
    "fit",
    "prepare",
    "read_mesh",
    "shipped_scenes",
    "sweep",
]
