"""Exceptions, one class for each kind of failure. Each message names the file, line or key, the problem and the remedy."""


class PalpateError(Exception):
    """Any failure of the engine."""


class InputError(PalpateError, ValueError):
    """A file, a key of a scene or an argument cannot be used."""


class OutputError(PalpateError, OSError):
    """A file cannot be written."""


class DeviceError(PalpateError):
    """No Vulkan device can run palpate; the message says what to install."""


class VulkanError(PalpateError):
    """A call of the Vulkan driver failed."""


class OutOfMemoryError(PalpateError, MemoryError):
    """The memory of the device is too small for the scene."""


class SimulationError(PalpateError):
    """The simulation cannot go on."""
