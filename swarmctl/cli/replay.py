"""`swarmctl replay`: a recorded run, decided again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from swarmctl.cli import machine_code
from swarmctl.cli.console import EXPECTED, USAGE, err, fail, out, say
from swarmctl.report import record


def register(cli: typer.Typer) -> None:
    cli.command()(replay)


def replay(
    run: Annotated[Path, typer.Argument(help="A run folder, or its run.mcap.", show_default=False)],
) -> None:
    """Fold the recorded events of a run again and say whether the same was decided."""
    try:
        verdict = record.replay(
            record.record_path(run),
            lambda config: machine_code.prepare(config.area.rows * config.area.cols, err),
        )
    except record.RecordError as error:
        fail([str(error)], USAGE)
    if verdict.is_cut:
        say("the record has no end: its process died, or it was cut; what is whole of it is replayed")
    if verdict.difference:
        fail([f"differs: {verdict.difference}"], EXPECTED)
    out.print(
        f"the same: {verdict.events} events gave the {verdict.effects} effects recorded", highlight=False
    )
