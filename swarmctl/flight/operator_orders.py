"""Who may order what of the vehicles of this process, and where orders come in."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from swarmctl.bus.endpoint import NOBODY, parse_endpoint
from swarmctl.bus.operator_service import Desk, Tally, Unseal
from swarmctl.bus.transports.base import Transport
from swarmctl.config.scenario import Scenario
from swarmctl.core.messages import GiveOrder, Request
from swarmctl.flight.member import Member
from swarmctl.flight.shutdown import turns_to_return
from swarmctl.report.ui import Ui


def order_desk(
    scenario: Scenario,
    transport: Transport,
    ui: Ui,
    commands: Tally,
    members: Sequence[Member],
    *,
    uav: int | None,
    closed_by: Callable[[Sequence[Member]], str] | None,
    unseal: Unseal,
) -> Desk:
    """Of the vehicle `uav`, or of the station for all; `members` may be filled later.

    `closed_by` says why orders are not taken now; None: one process flies all.
    """

    def closed(command: Request) -> str:
        if not isinstance(command, GiveOrder):
            return ""
        if closed_by is not None:
            return closed_by(members)
        return orders_closed(scenario, members, command)

    return Desk(
        transport,
        scenario.config.name,
        ui.say,
        commands,
        uav=uav,
        closed=closed,
        turns=partial(turns_to_return, members, ui.say),
        unseal=unseal,
    )


def orders_closed(scenario: Scenario, members: Sequence[Member], order: GiveOrder) -> str:
    """Why one process that flies all does not take an order; empty if it does.

    Nobody is asked who it is. So nobody launches an aircraft, and others than this machine order it nothing.
    """
    real = [m.name for m in members if m.identity is None or not m.identity.simulated]
    listen = scenario.config.communication.listen
    if not real:
        return ""
    if order.order == "launch":
        return f"{', '.join(real)} is not played by the built-in simulator: only `swarmctl fly` launches it"
    if listen == NOBODY or parse_endpoint(listen).is_loopback:
        return ""
    return (
        f"{', '.join(real)} is not played by the built-in simulator, and others than this machine reach "
        f"{listen}: set communication.listen to tcp/127.0.0.1:0, or fly with `swarmctl agent` and keys"
    )
