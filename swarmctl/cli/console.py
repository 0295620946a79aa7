"""Output, exit codes and common options of the commands."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from rich.console import Console

from swarmctl.core.operator_text import typed_names

OK, FAILED, USAGE, BUG, INTERRUPTED = 0, 1, 2, 3, 130

FILE_COLUMNS = 140
"""width of output to a file or a pipe"""
# Without emoji: they would replace a line number such as `:100:`.
out = Console(width=None if sys.stdout.isatty() else FILE_COLUMNS, emoji=False)
err = Console(stderr=True, emoji=False)

STYLE: dict[str, Any] = {"pretty_exceptions_enable": False, "rich_markup_mode": "markdown"}
"""attributes of the program's and each command's Typer application"""

_CONFIG = typer.Option(
    "--config",
    "-c",
    metavar="FILE",
    help="Configuration of the swarm (YAML), such as configs/swarm.yaml. `swarmctl init` writes one.",
    show_default=False,
)
ConfigOption = Annotated[Path, _CONFIG]
ConfigOrExampleOption = Annotated[Path | None, _CONFIG]
ExampleOption = Annotated[
    str | None,
    typer.Option(
        "--example",
        metavar="NAME",
        help="A shipped configuration instead of --config, such as swarm.",
        show_default=False,
    ),
]
ConnectOption = Annotated[
    str | None,
    typer.Option(metavar="tcp/HOST:PORT", help="The router's endpoint, instead of communication.router."),
]
OutOption = Annotated[Path, typer.Option("--out", help="Parent folder of the run folders.")]
VerboseOption = Annotated[bool, typer.Option("--verbose", "-v", help="Show all messages.")]


def split_items(texts: list[str] | None) -> list[str]:
    """Return all items of an option that may be repeated and may have several items, separated by commas."""
    return [item for text in texts or () for item in typed_names(text)]


def say(text: str, style: str | None = None, console: Console = out) -> None:
    """Print a text without markup, highlighting or added line breaks."""
    console.print(text, style=style, highlight=False, markup=False, soft_wrap=True)


def say_error(text: str) -> None:
    """Print an error to the standard error output."""
    say(text, "red", err)


def timed(text: str) -> str:
    """Return the text with this machine's local time in front."""
    return f"{datetime.now().astimezone():%H:%M:%S} {text}"


def log(text: str) -> None:
    """Print a text with this machine's local time in front."""
    say(timed(text))


def fail(lines: Sequence[str], code: int) -> NoReturn:
    """Print errors to the standard error output, and exit with `code`."""
    for text in lines:
        say_error(text)
    raise typer.Exit(code)


def run_folder(parent: Path, name: str) -> Path:
    """Create a new folder for the files of a run, and return its path; exit if this is impossible."""
    stamp = datetime.now().astimezone().strftime("%Y%m%d-%H%M%S")
    for suffix in ("", *(f"-{n}" for n in range(2, 1000))):
        folder = parent / f"{stamp}-{name}{suffix}"
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError as error:
            fail([f"the run folder {folder} cannot be created: {error.strerror or error}"], FAILED)
        return folder
    raise AssertionError("1000 runs in a second")
