"""What the commands have in common: where they print, their exit codes, and options of one meaning."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Annotated, NoReturn

import typer
from rich.console import Console

OK, EXPECTED, USAGE, BUG, INTERRUPTED = 0, 1, 2, 3, 130

WIDE = 140
"""columns where nobody looks at a terminal"""
out = Console(width=None if sys.stdout.isatty() else WIDE)
err = Console(stderr=True)

ConfigOption = Annotated[
    Path,
    typer.Option("--config", "-c", help="The swarm, as YAML; see configs/swarm.yaml.", show_default=False),
]
OutOption = Annotated[Path, typer.Option("--out", help="Where run folders are made.")]
VerboseOption = Annotated[bool, typer.Option("--verbose", "-v", help="Show everything that is said.")]


def say(text: str) -> None:
    """A line of what was asked for, just as it is."""
    out.print(text, highlight=False, markup=False, soft_wrap=True)


def timed(text: str) -> str:
    """A line of a log, with the time by this machine's clock."""
    return f"{datetime.now().astimezone():%H:%M:%S} {text}"


def log(text: str) -> None:
    """Something that happened, and when."""
    say(timed(text))


def fail(lines: Sequence[str], code: int) -> NoReturn:
    """Say what went wrong and leave."""
    for text in lines:
        err.print(text, style="red", highlight=False, markup=False, soft_wrap=True)
    raise typer.Exit(code)


def run_folder(parent: Path, name: str) -> Path:
    """A new folder for what a run leaves."""
    stamp = datetime.now().astimezone().strftime("%Y%m%d-%H%M%S")
    for suffix in ("", *(f"-{n}" for n in range(2, 1000))):
        folder = parent / f"{stamp}-{name}{suffix}"
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError as error:
            fail([f"the run folder {folder} cannot be made: {error.strerror or error}"], EXPECTED)
        return folder
    raise AssertionError("a thousand runs in a second")
