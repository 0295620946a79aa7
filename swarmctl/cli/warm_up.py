"""`swarmctl warm-up`: compile the planners before the first flight that needs machine code."""

from __future__ import annotations

from swarmctl.cli import machine_code
from swarmctl.cli.console import FAILED, fail, out, say
from swarmctl.planners.kernels.compilation import numba_cache


def warm_up() -> None:
    """Compile the planners for large areas, groups and benevolence, once on a machine."""
    if (stored := numba_cache()) is None:
        fail(["machine code cannot be stored; set NUMBA_CACHE_DIR to a writable folder"], FAILED)
    folder, _ = stored
    if machine_code.is_ready():
        say(f"the planners are already compiled: {folder}")
        return
    try:
        took_s = machine_code.compile_all(out)
    except machine_code.CompilerError as error:
        fail([str(error)], FAILED)
    say(f"the planners were compiled in {took_s:.0f} s: {folder}")
