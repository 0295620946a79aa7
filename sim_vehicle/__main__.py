"""`python -m sim_vehicle`: a fleet of copters on a MAVLink link."""

import asyncio
import contextlib
import signal
import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.live import Live

from sim_vehicle.display import fleet_table
from sim_vehicle.fleet import Fleet
from sim_vehicle.scenario import Scenario, ScenarioError, default_scenario, load_scenario
from sim_vehicle.server import LinkError, Server
from sim_vehicle.url import FORMS, UrlError, parse_url

USAGE_ERROR = 2
DEFAULT_HOME = "46.0490,14.5060,300"  # Ljubljana, Slovenia
REFRESH_HZ = 4.0

app = typer.Typer(add_completion=False, rich_markup_mode=None)


@app.command()
def main(
    count: Annotated[int, typer.Option(min=1, max=250, help="How many copters (without --scenario).")] = 1,
    home: Annotated[
        str,
        typer.Option(
            metavar="LAT,LON,ALT",
            help="Where the first stands [deg, deg, m above sea level]; the others 5 m apart to the east. "
            "The default is in Ljubljana, Slovenia.",
        ),
    ] = DEFAULT_HOME,
    speedup: Annotated[float, typer.Option(min=0.1, max=1000, help="Simulated seconds per second.")] = 1.0,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Of all randomness; overrides the scenario's.")
    ] = None,
    ready_s: Annotated[
        float,
        typer.Option(min=0, max=3600, help="Simulated seconds from boot to a position estimate; 0: at once."),
    ] = 41.0,
    scenario: Annotated[Path | None, typer.Option(help="JSON file with vehicles, area and hostiles.")] = None,
    url: Annotated[str, typer.Option(help=f"Where to talk: {FORMS}.")] = "udpout:127.0.0.1:14550",
    sysid: Annotated[
        int, typer.Option(min=1, max=250, help="System id of the first (without --scenario).")
    ] = 1,
    parent_pid: Annotated[int | None, typer.Option(help="Stop when this process is gone.")] = None,
) -> None:
    """Simulated copters that behave like ArduCopter 4.6 on a MAVLink link. Ctrl-C stops them."""
    try:
        link_url = parse_url(url)
        chosen = _scenario(scenario, count, home, sysid, seed)
        server = Server(
            Fleet(chosen, ready_s=ready_s), link_url, speedup=speedup, parent_pid=parent_pid, warn=_warn
        )
        asyncio.run(_run(server, f"{_fleet_words(server.fleet)}, {link_url}, {speedup:g}x real time"))
    except (ScenarioError, UrlError, LinkError) as error:
        typer.echo(f"sim_vehicle: {error}", err=True)
        raise typer.Exit(USAGE_ERROR) from error


def _warn(text: str) -> None:
    typer.echo(f"sim_vehicle: {text}", err=True)


def _scenario(path: Path | None, count: int, home: str, sysid: int, seed: int | None) -> Scenario:
    if path is not None:
        loaded = load_scenario(path)
        return loaded if seed is None else loaded.model_copy(update={"seed": seed})
    return default_scenario(count, home=_parse_home(home), first_sysid=sysid, seed=seed or 0)


def _parse_home(text: str) -> tuple[float, float, float]:
    try:
        lat_deg, lon_deg, alt_m = (float(part) for part in text.split(","))
    except ValueError as error:
        raise ScenarioError(f"--home {text!r} is not LAT,LON,ALT, for example {DEFAULT_HOME}") from error
    return lat_deg, lon_deg, alt_m


def _fleet_words(fleet: Fleet) -> str:
    sysids = sorted(fleet.sysids)
    if len(sysids) == 1:
        return f"1 copter, sysid {sysids[0]}"
    contiguous = sysids == list(range(sysids[0], sysids[-1] + 1))
    named = f"{sysids[0]}-{sysids[-1]}" if contiguous else ",".join(map(str, sysids))
    return f"{len(sysids)} copters, sysid {named}"


async def _run(server: Server, words: str) -> None:
    """Run until SIGINT, SIGTERM or the parent's end."""
    loop = asyncio.get_running_loop()
    running = asyncio.ensure_future(server.run(on_open=lambda: typer.echo(f"sim_vehicle: {words}")))
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, running.cancel)
    showing = asyncio.ensure_future(_show(server)) if sys.stdout.isatty() else None
    try:
        with contextlib.suppress(asyncio.CancelledError):
            await running
    finally:
        if showing is not None:
            showing.cancel()


async def _show(server: Server) -> None:
    with Live(console=Console(), auto_refresh=False) as live:
        while True:
            live.update(fleet_table(server.fleet, server.simulated_s, server.speedup), refresh=True)
            await asyncio.sleep(1 / REFRESH_HZ)


if __name__ == "__main__":
    app()
