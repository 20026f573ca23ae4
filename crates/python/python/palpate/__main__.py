"""The program: ``python -m palpate run scene.toml`` is ``palpate run scene.toml``."""

import signal
import sys

from . import native


def main() -> int:
    """Run the program with the arguments of the command line; return its exit status."""
    # Python would only note an interrupt and wait for the program's end.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return native.program(["palpate", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
