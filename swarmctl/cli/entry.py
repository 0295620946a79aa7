"""The console script. Ctrl-C ends the program with the right exit code at any time, even during imports."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType

INTERRUPTED = 130


def _exit(_number: int, _frame: FrameType | None) -> None:
    sys.exit(INTERRUPTED)


def _exit_at_once(_number: int, _frame: FrameType | None) -> None:
    os._exit(INTERRUPTED)


def main() -> None:
    """Run the command line."""
    # During the imports no file is open. An exception would print a long traceback, so Ctrl-C exits at once.
    signal.signal(signal.SIGINT, _exit_at_once)
    from swarmctl.cli.main import main as run  # noqa: PLC0415 - a slow import

    signal.signal(signal.SIGINT, _exit)
    run()
