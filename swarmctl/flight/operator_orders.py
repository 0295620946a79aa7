"""The operator service of a flight, and the conditions under which the service accepts orders."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from swarmctl.bus.authentication import NO_AUTHENTICATION, Authentication
from swarmctl.bus.endpoint import NO_ENDPOINT, parse_endpoint
from swarmctl.bus.operator_service import OperatorService
from swarmctl.bus.transports.base import Transport
from swarmctl.config.scenario import Scenario
from swarmctl.core.messages import GiveOrder, Request
from swarmctl.flight.member import Member
from swarmctl.flight.shutdown import return_delays_s


def operator_service_for(
    scenario: Scenario,
    transport: Transport,
    say: Callable[[str], None],
    members: Sequence[Member],
    *,
    uav: int | None,
    order_refusal: Callable[[Sequence[Member]], str] | None,
    authentication: Authentication,
) -> OperatorService:
    """Return the operator service of vehicle `uav`, or of all vehicles if `uav` is None.

    `order_refusal` returns the reason why orders are refused now, or an empty
    text. If `order_refusal` is None, `unsigned_order_refusal` decides.
    """

    def refusal(command: Request) -> str:
        if authentication is NO_AUTHENTICATION and (real := _real_vehicles(members)):
            return (
                f"the bus of this flight authenticates no sender, so real vehicles ({', '.join(real)}) "
                "refuse commands: give FlightOptions.authentication [orders-need-keys]"
            )
        if not isinstance(command, GiveOrder):
            return "" if command.range is None else range_refusal(scenario, members)
        if order_refusal is not None:
            return order_refusal(members)
        return unsigned_order_refusal(scenario, members, command)

    return OperatorService(
        transport,
        scenario.config.name,
        say,
        {member.spec.sysid: member.runner for member in members},
        uav=uav,
        refusal=refusal,
        delays=partial(return_delays_s, members, say),
        authentication=authentication,
    )


def _real_vehicles(members: Sequence[Member]) -> list[str]:
    return [m.name for m in members if m.identity is None or not m.identity.simulated]


def range_refusal(scenario: Scenario, members: Sequence[Member]) -> str:
    """Return the reason why the range of communication cannot be changed; empty in a simulated swarm."""
    real = dict.fromkeys([s.name for s in scenario.swarm if not s.simulated] + _real_vehicles(members))
    if not real:
        return ""
    return (
        f"the range of communication is a part of the simulation, and real vehicles fly ({', '.join(real)}); "
        "set communication.range before the flight [range-of-real-vehicles]"
    )


def unsigned_order_refusal(scenario: Scenario, members: Sequence[Member], order: GiveOrder) -> str:
    """Return the reason why a process that flies all vehicles refuses an order; empty for an accepted order.

    A token shows only that the sender knows a secret. Therefore no order launches a real vehicle, and real
    vehicles accept orders from this machine only.
    """
    real = _real_vehicles(members)
    listen = scenario.config.communication.listen
    if not real:
        return ""
    if order.order == "launch":
        return f"only `swarmctl fly` launches real vehicles ({', '.join(real)}) [launch-by-fly-only]"
    if listen == NO_ENDPOINT or parse_endpoint(listen).is_loopback:
        return ""
    return (
        f"other machines reach {listen}, where orders need no key, so real vehicles ({', '.join(real)}) "
        "refuse orders: set communication.listen to tcp/127.0.0.1:0, or fly with `swarmctl agent` and keys "
        "[orders-need-keys]"
    )
