"""The console script: Ctrl-C has its exit code from the first moment, also while the rest is imported."""

from __future__ import annotations

import signal
import sys
from types import FrameType

INTERRUPTED = 130


def _leave(_number: int, _frame: FrameType | None) -> None:
    sys.exit(INTERRUPTED)


def main() -> None:
    """The entry point of the package."""
    signal.signal(signal.SIGINT, _leave)
    from swarmctl.cli import main as run  # noqa: PLC0415 - this is what takes a while

    run()
