"""One agent a machine: flies one vehicle of a configuration, with the others' agents elsewhere."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from swarmctl.agent.state import ARRIVED, AgentState, Phase
from swarmctl.bus.operator_service import unsealed
from swarmctl.bus.transports.base import Transport
from swarmctl.bus.transports.memory import MemoryBus
from swarmctl.bus.transports.routes import SaidOnce
from swarmctl.bus.transports.zenoh import ZenohBus
from swarmctl.bus.transports.zenoh_config import Configuration
from swarmctl.config import joining
from swarmctl.config.scenario import Scenario
from swarmctl.core.events import Order
from swarmctl.core.frames import Seal
from swarmctl.flight import app
from swarmctl.flight.app import Manner
from swarmctl.flight.director import Launch, Permission
from swarmctl.flight.member import Member
from swarmctl.flight.supervise import cancelled
from swarmctl.flight.virtual_simulator import Carry, undisturbed
from swarmctl.flight.wiring import Clock
from swarmctl.links.url import parse_url
from swarmctl.preflight.waivers import Waiver
from swarmctl.report.outcome import Report
from swarmctl.report.ui import Steady, Ui
from swarmctl.security.evidence_keys import Witness
from swarmctl.security.participant import Keyring
from swarmctl.security.requests import Opener, seal_answer

FIRST_LINK_S = 3.0
"""A network that is not there by then is said to be missing."""
LOOKED_AT_EVERY_S = 0.5


def only(scenario: Scenario, uav: int, url: str | None = None) -> Scenario:
    """The scenario, of which this process flies one vehicle, at `url` if that is not its configuration's.

    All else (altitude, landing spot, seeds, what its sensor sees) is as if one process flew them all.
    """
    alone = scenario.only(uav)
    (spec,) = alone.specs
    if url is not None:
        spec = replace(spec, url=url, simulated=False)
    elif spec.simulated:
        # A simulator of its own, beside those of other agents that may run on this machine.
        spec = replace(spec, url=str(replace(parse_url(spec.url), port=0)))
    return replace(alone, specs=(spec,))


def orders_closed(members: Sequence[Member], *, has_keys: bool) -> str:
    """Why operators' orders are not taken; empty if they are.

    Without keys nobody knows who gives an order, and whoever reaches the network could launch an aircraft, or
    drop one: then only vehicles that the built-in simulator plays take any.
    """
    real = [m.name for m in members if m.identity is None or not m.identity.simulated]
    if has_keys or not real:
        return ""
    return (
        f"{', '.join(real)} is not played by the built-in simulator, and nobody could tell who gives an "
        "order: make keys with `swarmctl keys` and set communication.keys"
    )


def called_back(report: Report) -> list[str]:
    """The vehicles whose flight an operator's order has ended, and that were seen to follow it.

    An order of their own process is none (it is how a run that is stopped ends), and who was given up, let go
    or disarmed on its way has failed, whatever it was ordered.
    """
    if report.ended != "ended":
        return []
    return [state.task.name for state in report.states.values() if _obeyed(state)]


def _obeyed(state: AgentState) -> bool:
    flown = state.armed_seen or state.launch_aborted
    return (
        state.phase is Phase.DONE
        and state.outcome != ARRIVED
        and flown
        and state.ordered in (Order.RETURN, Order.LAND)
        and state.order_seen
    )


async def fly(
    scenario: Scenario,
    folder: Path,
    ui: Ui,
    *,
    clock: Clock,
    permission: Permission,
    launch: Launch,
    network: Configuration | None = None,
    bus: Transport | None = None,
    keyring: Keyring | None = None,
    carry: Carry = undisturbed,
    waivers: tuple[Waiver, ...] = (),
) -> Report:
    """Fly what `only` has left, over `network`, over a bus that is open already, or in touch with nobody.

    A network that is not there yet, or ends, stops nothing. Raises BusError where it can never be opened.
    """
    (spec,) = scenario.specs
    manner = Manner(
        launch,
        spec.sysid,
        lambda members: orders_closed(members, has_keys=keyring is not None),
        seal=None if keyring is None else Seal(scenario.config.name, keyring.sign, keyring.verify),
        unseal=unsealed if keyring is None else _Unseal(scenario, keyring),
        signer=None if keyring is None else Witness(keyring.name, keyring.signer),
        waivers=waivers,
    )

    async def flight(bus: Transport) -> Report:
        report = await app.fly(
            scenario, folder, ui, clock=clock, permission=permission, carry=carry, bus=bus, manner=manner
        )
        if report.summary:
            report.summary["ended_by_operator"] = called_back(report)
        return report

    face = Steady(ui)
    failed = SaidOnce(face.say)
    if network is None:
        return await flight(bus or MemoryBus(failed))
    with ZenohBus(network, on_failure=failed) as zenoh:
        watch = asyncio.create_task(_say_links(zenoh, network, face))
        try:
            return await flight(zenoh)
        finally:
            await cancelled(watch)


class _Unseal:
    """Takes what the operator has signed, from now on, and signs what the vehicle answers."""

    def __init__(self, scenario: Scenario, keyring: Keyring) -> None:
        tolerance_s = scenario.config.communication.clock_tolerance_s
        self._swarm = scenario.config.name
        self._sign = keyring.signer.sign
        self._opener = Opener(self._swarm, keyring.is_operators, time.time(), tolerance_s)

    def open(self, key: str, payload: bytes) -> bytes:
        return self._opener.open(key, payload, time.time())

    def close(self, key: str, payload: bytes, answer: bytes) -> bytes:
        return seal_answer(self._swarm, key, payload, answer, self._sign)


async def _say_links(bus: ZenohBus, network: Configuration, ui: Ui) -> None:
    """Say once when the network goes, or is not there from the start, and when it comes."""
    there = None
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(FIRST_LINK_S):
            while not bus.connected:  # noqa: ASYNC110 - it comes and goes on threads of Zenoh's
                await asyncio.sleep(LOOKED_AT_EVERY_S)
    while True:
        if bus.connected is not there:
            there = bus.connected
            ui.say("in touch with the swarm's network" if there else _missing(bus, network))
        await asyncio.sleep(LOOKED_AT_EVERY_S)


def _missing(bus: ZenohBus, network: Configuration) -> str:
    where = f": {bus.trouble}" if bus.trouble else ""
    return (
        f"nobody of the swarm's network is reached{where}; flying by what is known here until it is "
        f"({joining.not_reached(network)})"
    )
