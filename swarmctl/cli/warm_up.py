"""`swarmctl warm-up`: compile the planners before the first flight that needs machine code."""

from __future__ import annotations

from swarmctl.cli import machine_code
from swarmctl.cli.console import FAILED, fail, out, say


def warm_up() -> None:
    """Compile the planners for large areas, groups and benevolence, once on a machine."""
    try:
        file = machine_code.ready_file()
        if file.exists():
            say(f"the planners are already compiled: {file.parent}")
            return
        took_s = machine_code.compile_all(out)
    except machine_code.CompilerError as error:
        fail([str(error)], FAILED)
    say(f"the planners were compiled in {took_s:.0f} s: {file.parent}")
