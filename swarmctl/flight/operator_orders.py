"""The operator service of a process, and the conditions under which the service accepts orders."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from swarmctl.bus.authentication import NO_AUTHENTICATION, Authentication
from swarmctl.bus.endpoint import NO_ENDPOINT, parse_endpoint
from swarmctl.bus.operator_service import OperatorService
from swarmctl.bus.transports.base import Transport
from swarmctl.config.scenario import Scenario
from swarmctl.core.messages import GiveOrder, Request
from swarmctl.flight.own_vehicle import OwnVehicle, names, not_simulated


def operator_service_for(
    scenario: Scenario,
    transport: Transport,
    say: Callable[[str], None],
    vehicles: Sequence[OwnVehicle],
    *,
    flies_all: bool,
    has_keys: bool,
    authentication: Authentication,
) -> OperatorService:
    """Return the operator service of a process.

    flies_all: the process flies all vehicles of the swarm
    has_keys: the operator's key signs the orders
    """

    def refusal(command: Request) -> str:
        if authentication is NO_AUTHENTICATION and (real := names(not_simulated(vehicles))):
            return (
                f"the bus of this flight authenticates no sender, so real vehicles ({real}) refuse commands: "
                "give FlightOptions.authentication [orders-need-keys]"
            )
        if isinstance(command, GiveOrder):
            return order_refusal(scenario, vehicles, command, flies_all=flies_all, has_keys=has_keys)
        return "" if command.range is None else range_refusal(scenario, vehicles)

    return OperatorService(
        transport,
        scenario.config.name,
        say,
        {vehicle.spec.sysid: vehicle.runner for vehicle in vehicles},
        flies_all=flies_all,
        refusal=refusal,
        authentication=authentication,
    )


def range_refusal(scenario: Scenario, vehicles: Sequence[OwnVehicle]) -> str:
    """Return the reason why the range of communication cannot be changed; empty in a simulated swarm."""
    others = [spec.name for spec in scenario.swarm if not spec.simulated]
    real = dict.fromkeys([*others, *(vehicle.name for vehicle in not_simulated(vehicles))])
    if not real:
        return ""
    return (
        f"the range of communication is a part of the simulation, and real vehicles fly ({', '.join(real)}); "
        "set communication.range before the flight [range-of-real-vehicles]"
    )


def order_refusal(
    scenario: Scenario, vehicles: Sequence[OwnVehicle], order: GiveOrder, *, flies_all: bool, has_keys: bool
) -> str:
    """Return the reason why an order is refused; empty for an accepted order.

    Without keys the sender of an order is unknown: any host on the network could launch or land an aircraft.
    So an agent without keys accepts orders for vehicles of the built-in simulator only. A process that flies
    all vehicles has a token, which shows only that the sender knows a secret. Therefore no order launches a
    real vehicle there, and real vehicles accept orders from this machine only.
    """
    real = names(not_simulated(vehicles))
    if not real or (has_keys and not flies_all):
        return ""
    if not flies_all:
        return (
            f"orders without keys have no proven sender, so real vehicles ({real}) refuse them: make keys "
            "with `swarmctl keys` and set communication.keys [orders-need-keys]"
        )
    if order.order == "launch":
        return f"only `swarmctl fly` launches real vehicles ({real}) [launch-by-fly-only]"
    listen = scenario.config.communication.listen
    if listen == NO_ENDPOINT or parse_endpoint(listen).is_loopback:
        return ""
    return (
        f"other machines reach {listen}, where orders need no key, so real vehicles ({real}) refuse orders: "
        "set communication.listen to tcp/127.0.0.1:0, or fly with `swarmctl agent` and keys "
        "[orders-need-keys]"
    )
