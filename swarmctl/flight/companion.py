"""An agent on its own machine, for one vehicle of a swarm; other machines fly the other vehicles."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from swarmctl.bus import directory
from swarmctl.bus.transports.base import BusError, Transport
from swarmctl.bus.transports.memory import MemoryBus
from swarmctl.bus.transports.subscriptions import ReportOnce
from swarmctl.bus.transports.zenoh import ZenohBus
from swarmctl.bus.transports.zenoh_config import Configuration
from swarmctl.config import joining
from swarmctl.config.scenario import Scenario
from swarmctl.core.frames import FrameCodec
from swarmctl.core.records import replace
from swarmctl.flight import app
from swarmctl.flight.director import LaunchMode
from swarmctl.flight.permission import Permission
from swarmctl.flight.run import Clock, FlightOptions
from swarmctl.links.url import parse_url
from swarmctl.preflight.waivers import Waiver
from swarmctl.report.outcome import FlightReport
from swarmctl.report.ui import SafeUi, Ui
from swarmctl.report.unfinished_run import UnfinishedRun
from swarmctl.security import requests
from swarmctl.security.evidence_keys import EvidenceSigner
from swarmctl.security.participant import Keyring
from swarmctl.security.token import new_token, token_of_environment

REPORT_MISSING_AFTER_S = 3.0
"""time from the start to the message about a missing network [s]"""
POLL_S = 0.5
NETWORK_REACHED = "the agent is connected to the swarm's network [network-reached]"


def scenario_for(scenario: Scenario, uav: int, url: str | None = None) -> Scenario:
    """Return the scenario for one vehicle, at `url` if given, else at the configured or simulator's address.

    Altitude, landing spot, seeds and sensor are the same as when one process flies all vehicles.
    """
    alone = scenario.only(uav)
    (spec,) = alone.specs
    if url is not None:
        spec = replace(spec, url=url, simulated=False)
    elif spec.simulated:
        # A free port: other agents on this machine may run simulators too.
        spec = replace(spec, url=str(replace(parse_url(spec.url), port=0)))
    return replace(alone, specs=(spec,))


async def fly(
    scenario: Scenario,
    folder: Path,
    ui: Ui,
    *,
    clock: Clock,
    permission: Permission,
    launch: LaunchMode,
    network: Configuration | None = None,
    bus: Transport | None = None,
    keyring: Keyring | None = None,
    waivers: tuple[Waiver, ...] = (),
    resumes: UnfinishedRun | None = None,
) -> FlightReport:
    """Fly the vehicle of `scenario_for`. Messages use `network`, or else the open transport `bus`.

    If both are None, the vehicle exchanges no messages. The flight continues while the network is missing.
    Raises BusError if the network cannot be opened, and KeyringError for an unusable SWARMCTL_TOKEN_FILE.
    """
    options = FlightOptions(launch, flies_all=False, waivers=waivers, resumes=resumes)
    if keyring is not None:
        name, tolerance_s = scenario.config.name, scenario.config.communication.clock_tolerance_s
        options = replace(
            options,
            frame_codec=FrameCodec(name, keyring.sign, keyring.verify),
            authentication=requests.by_operator(name, keyring, tolerance_s, time.time),
            signer=EvidenceSigner(keyring.name, keyring.signing_key),
        )
    ui = SafeUi(ui)
    flown = partial(app.fly, scenario, folder, ui, clock=clock, permission=permission)
    failed = ReportOnce(ui.say)
    if network is None:
        return await flown(bus=bus or MemoryBus(failed), options=options)
    with contextlib.ExitStack() as stack:
        if keyring is None:
            options = stack.enter_context(_with_token(scenario, options, ui))
        zenoh = stack.enter_context(ZenohBus(network, on_failure=failed))
        watch_bus = partial(_report_connection, zenoh, network, ui)
        return await flown(bus=zenoh, options=replace(options, watch_bus=watch_bus))


@contextlib.contextmanager
def _with_token(scenario: Scenario, options: FlightOptions, ui: Ui) -> Iterator[FlightOptions]:
    """Yield the options with a token for operators' commands and payloads' reports. Raises KeyringError.

    The token is in the directory of running swarms while the context lasts.
    """
    (spec,) = scenario.specs
    token = token_of_environment() or new_token()
    with contextlib.ExitStack() as stack:
        try:
            stack.enter_context(directory.registered_agent(scenario.config.name, spec.sysid, token.text))
        except BusError as error:
            ui.say(
                "the agent accepts commands and reports only from senders with the same SWARMCTL_TOKEN_FILE: "
                f"{error} [not-registered]"
            )
        tolerance_s = scenario.config.communication.clock_tolerance_s
        checked = requests.by_token(scenario.config.name, token, tolerance_s, time.time)
        yield replace(options, authentication=checked, report_authentication=checked)


async def _report_connection(bus: ZenohBus, network: Configuration, ui: Ui) -> None:
    """Report each connection and disconnection, and a network that is missing after the start."""
    connected = None
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(REPORT_MISSING_AFTER_S):
            while not bus.connected:  # noqa: ASYNC110 - Zenoh's threads change `connected`
                await asyncio.sleep(POLL_S)
    while True:
        if bus.connected is not connected:
            connected = bus.connected
            ui.say(NETWORK_REACHED if connected else _missing(bus, network))
        await asyncio.sleep(POLL_S)


def _missing(bus: ZenohBus, network: Configuration) -> str:
    reason = f": {bus.trouble}" if bus.trouble else ""
    return (
        f"the agent is not connected to the swarm's network{reason}; until it is, the vehicle flies by its "
        f"own observations; {joining.connection_advice(network)} [network-missing]"
    )
