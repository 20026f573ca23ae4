"""Vulkan devices."""

from dataclasses import dataclass

from . import native


@dataclass(frozen=True)
class Device:
    """A Vulkan device of this machine."""

    index: int
    """Index in the loader's list, from 0; it may be given in place of a name."""
    name: str
    """Name that the driver gives the device."""
    driver: str
    """Name and version of the driver."""
    vulkan: str
    """Vulkan version that the driver offers, such as ``1.3.230``."""
    problem: str | None
    """Why palpate cannot use the device; ``None`` if it can."""


def devices() -> list[Device]:
    """List the Vulkan devices of this machine; the list is empty where no driver is installed."""
    return [Device(*device) for device in native.devices()]


class Context:
    """An open Vulkan device, which simulations may share.

    A simulation opens a device of its own where it is given none.

    Args:
        device: Part of the device's name, or its index in :func:`devices`. ``None``: the first usable one, in the order
            discrete GPU, integrated GPU, virtual GPU, CPU.
        threads: Worker threads of Mesa's CPU driver lavapipe besides the calling one: a number, or ``None`` for the
            driver's choice. Other drivers ignore it. It is set by an environment variable, unless that is set already.
        cache: Whether prepared bodies, pipelines and a few measurements are kept in the user's cache folder
            (``PALPATE_CACHE``, else ``~/.cache/palpate``).
        validation: Whether to use the Khronos validation layer.

    Raises:
        DeviceError: No device can be used; the message says what to install.
    """

    def __init__(
        self,
        device: str | int | None = None,
        *,
        threads: int | None = None,
        cache: bool = True,
        validation: bool = False,
    ) -> None:
        name = None if device is None else str(device)
        self._native = native.Context(name, None if threads is None else str(threads), cache, None, validation)

    @property
    def device(self) -> str:
        """Name of the device."""
        return self._native.device

    @property
    def driver(self) -> str:
        """Name and version of the driver."""
        return self._native.driver

    def __repr__(self) -> str:
        return f"Context({self.device!r})"
