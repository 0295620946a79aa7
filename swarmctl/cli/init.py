"""`swarmctl init`: a starter configuration."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from swarmctl.cli.console import FAILED, fail, say
from swarmctl.config.examples import MAX_STARTER_VEHICLES, starter


def init(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="File to write; an existing file is not overwritten.")
    ] = Path("swarm.yaml"),
    vehicles: Annotated[int, typer.Option(min=1, max=MAX_STARTER_VEHICLES, help="Number of vehicles.")] = 5,
    real: Annotated[
        bool,
        typer.Option(
            "--real",
            help="Real vehicles by MAVLink URL, not simulated vehicles. The lines to change are marked EDIT.",
        ),
    ] = False,
) -> None:
    """Write a starter configuration with comments, for simulated or real vehicles."""
    try:
        with file.open("x", encoding="utf-8") as target:
            target.write(starter(str(file), vehicles, real=real))
    except FileExistsError:
        fail([f"{file}: the file exists and was not changed; give another name"], FAILED)
    except OSError as error:
        fail([f"{file}: the file cannot be written: {error.strerror or error}"], FAILED)
    edit = "edit the lines marked EDIT, then run" if real else "next, run"
    say(f"{file}: written; {edit} `swarmctl check --config {file}`")
