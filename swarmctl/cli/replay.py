"""`swarmctl replay`: repeat the decisions of a recorded run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from swarmctl.cli import machine_code
from swarmctl.cli.console import FAILED, USAGE, err, fail, say
from swarmctl.report import record, record_file


def replay(
    run: Annotated[
        Path, typer.Argument(metavar="RUN", help="A run folder, or its run.mcap.", show_default=False)
    ],
) -> None:
    """Repeat the decisions of a recorded run, and report whether they are the same."""
    try:
        verdict = record.replay(
            record.record_path(run),
            lambda config: machine_code.prepare(config, err),
        )
    except record_file.RecordError as error:
        fail([str(error)], USAGE)
    if verdict.is_cut:
        say(
            "the record has no end: the recording process died, or the file was cut or damaged; "
            "only the part before is replayed [record-cut]"
        )
    if verdict.difference:
        fail([f"the decisions differ: {verdict.difference}"], FAILED)
    say(f"the decisions are the same: {verdict.events} events, {verdict.effects} effects")
