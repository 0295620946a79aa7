"""The last order of one vehicle. Pure."""

from __future__ import annotations

import math

import msgspec

from swarmctl.core.events import FlightOrder
from swarmctl.core.records import replace


class GivenOrder(msgspec.Struct, frozen=True):
    given: FlightOrder | None = None
    """last order for the vehicle, sent or only noted"""
    is_followed: bool = False
    """True once the vehicle's mode has confirmed the order, or the order keeps the vehicle on the ground"""
    repeat_at_s: float = math.inf
    """time to repeat an order that the vehicle does not follow, by the run's clock; inf: no repetition"""
    previous_own_roles: frozenset[str] = frozenset()
    """own mode roles before the order"""
    n_given: int = 0
    """number of orders so far"""
    failure: str = ""
    """last failure of an order, as text; empty once the vehicle follows an order"""

    def sent(self, order: FlightOrder, own_roles: frozenset[str]) -> GivenOrder:
        """Return the record of an order that is sent to a vehicle with these own mode roles."""
        return GivenOrder(order, previous_own_roles=own_roles, n_given=self.n_given + 1, failure=self.failure)

    def noted(self, order: FlightOrder) -> GivenOrder:
        """Return the record of an order that the vehicle follows without a message."""
        return replace(self, given=order, is_followed=True, repeat_at_s=math.inf)

    def followed(self) -> GivenOrder:
        """Return the record after the vehicle has confirmed the order."""
        return replace(self, is_followed=True, repeat_at_s=math.inf, failure="")

    def failed(self, failure: str) -> GivenOrder:
        """Return the record after the vehicle did not follow the order."""
        return replace(self, failure=failure)

    def repeated(self, at_s: float) -> GivenOrder:
        """Return the record of an order that is repeated at `at_s`; inf: never."""
        return replace(self, repeat_at_s=at_s)
