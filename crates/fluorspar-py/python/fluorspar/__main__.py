"""The program ``fluorspar``: ``python -m fluorspar`` and the command of the same name."""

from __future__ import annotations

import signal
import sys

from ._fluorspar import run_program


def main() -> int:
    """Runs the program with the arguments of this process and returns its exit code."""
    # The program listens to Ctrl-C itself.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return run_program(["fluorspar", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
