"""The launch of one vehicle: its order, its wait on the ground, and the arming that was seen. Pure."""

from __future__ import annotations

import msgspec

from swarmctl.agent.replan.climb import LIFT_S
from swarmctl.core.records import replace


class Launch(msgspec.Struct, frozen=True):
    """Times are by the vehicle's clock."""

    is_ordered: bool = False
    is_operators: bool = False
    """True: an operator ordered the launch; False: the agent's own process"""
    ignored: frozenset[int] = frozenset()
    """vehicles that the launch does not wait for, by an operator's order"""
    is_aborted: bool = False
    conflict: str = ""
    """conflict of the first route during the launch, as text; empty: none"""
    armed_boot_s: float | None = None
    """time at which the vehicle was first seen armed after its launch order; start of its time bound"""

    @property
    def armed_seen(self) -> bool:
        """True once the vehicle was seen armed after its launch order."""
        return self.armed_boot_s is not None

    def lifts_off_in_s(self, now_s: float) -> float:
        """Return the time until the lift-off of a copter on the ground [s]."""
        return LIFT_S if self.armed_boot_s is None else max(self.armed_boot_s + LIFT_S - now_s, 0.0)

    def withdrawn(self) -> Launch:
        """Return the launch without its order."""
        return replace(self, is_ordered=False)

    def not_begun(self) -> Launch:
        """Return the launch of a vehicle that is disarmed again."""
        return replace(self, armed_boot_s=None)

    def begun(self, boot_s: float) -> Launch:
        """Return the launch of a vehicle that is armed at `boot_s`; only the first time counts."""
        return self if self.armed_seen else replace(self, armed_boot_s=boot_s)

    def ended(self) -> Launch:
        """Return the launch of a vehicle in flight."""
        return replace(self, ignored=frozenset())
