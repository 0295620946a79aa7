"""The console script: Ctrl-C has its exit code from the first moment, also while the rest is imported."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType

INTERRUPTED = 130


def _leave(_number: int, _frame: FrameType | None) -> None:
    sys.exit(INTERRUPTED)


def _vanish(_number: int, _frame: FrameType | None) -> None:
    os._exit(INTERRUPTED)


def main() -> None:
    """The entry point of the package."""
    # Nothing is open yet, and an exception in the middle of an import is told at length.
    signal.signal(signal.SIGINT, _vanish)
    from swarmctl.cli.main import main as run  # noqa: PLC0415 - this is what takes a while

    signal.signal(signal.SIGINT, _leave)
    run()
