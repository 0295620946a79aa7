"""`swarmctl dashboard`: the browser's view of a recorded run, or of a flight in progress."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Annotated

import typer

from swarmctl.cli.console import FAILED, USAGE, fail, say
from swarmctl.report import record_file


def register(cli: typer.Typer) -> None:
    cli.command()(dashboard)


def dashboard(
    run: Annotated[Path, typer.Argument(help="A run folder, or its run.mcap.", show_default=False)],
    live: Annotated[bool, typer.Option("--live", help="Follow a flight in progress.")] = False,
    port: Annotated[int, typer.Option(help="The port on this machine; 0: a free one.", min=0, max=65535)] = 0,
) -> None:
    """Show a recorded run, or a flight in progress, in a browser on this machine."""
    try:
        from swarmctl.dashboard.server import serve  # noqa: PLC0415
    except ModuleNotFoundError as error:
        fail([f"the dashboard needs {error.name}: pip install 'mavlink-swarmctl[dashboard]'"], USAGE)
    from swarmctl.dashboard.sources.live_file import open_live  # noqa: PLC0415
    from swarmctl.dashboard.sources.recording import RecordSource  # noqa: PLC0415

    async def shown() -> None:
        source = await open_live(run) if live else RecordSource(run, "recording")
        await serve(source, port, lambda address: say(f"open this address once: {address}"))

    try:
        asyncio.run(shown())
    except record_file.RecordError as error:
        fail([str(error)], USAGE)
    except OSError as error:
        fail([f"port {port}: {error.strerror}; choose another --port"], FAILED)
