"""How long changing a vehicle's mission takes, and what it costs: as measured on its own last swaps. Pure."""

from __future__ import annotations

from dataclasses import dataclass, replace

KEPT = 3
"""of the last swaps, of which the worst is expected"""
PRIOR_S = 1.5
"""until it flies its new plan, at least, before any was measured"""
SPARE_S, SPARE_SHARE = 0.5, 0.25
"""more than was measured: positions come four times a second, and no two links and plans are alike"""
MOST_S = 60.0
STANDS_S = 0.3
"""less is no stop: a position's worth of a slow turn"""


@dataclass(frozen=True, slots=True)
class SwapTimes:
    """Of the last swaps of one vehicle, by its own clock."""

    took_s: tuple[float, ...] = ()
    """from the decision until it flew the new plan"""
    stood_s: tuple[float, ...] = ()
    """for how long it held or stood still for it"""
    prior_s: float = PRIOR_S
    """expected before any was measured"""

    @classmethod
    def expecting(cls, takes_s: float) -> SwapTimes:
        """Of a vehicle on the ground, by how long its link took for an upload."""
        return cls(prior_s=min(max(_with_spare_s(takes_s), PRIOR_S), MOST_S))

    def measured(self, took_s: float, stood_s: float) -> SwapTimes:
        """With one more."""
        return SwapTimes((*self.took_s, took_s)[-KEPT:], (*self.stood_s, stood_s)[-KEPT:], self.prior_s)

    def too_late(self) -> SwapTimes:
        """After one that came when the vehicle was past where its new plan began."""
        return replace(self, took_s=(*self.took_s, min(2.0 * self.expected_s, MOST_S))[-KEPT:])

    @property
    def expected_s(self) -> float:
        """For so long it flies on along its old plan."""
        return _with_spare_s(max(self.took_s)) if self.took_s else self.prior_s

    @property
    def likely_s(self) -> float:
        """So long it will take, without any to spare."""
        return max(self.took_s, default=self.prior_s)

    @property
    def stop_s(self) -> float | None:
        """For so long it is expected to stand; 0 where it flies on, None before any swap was measured."""
        if not self.stood_s:
            return None
        longest_s = max(self.stood_s)
        return longest_s if longest_s > STANDS_S else 0.0


def _with_spare_s(took_s: float) -> float:
    return (1.0 + SPARE_SHARE) * took_s + SPARE_S
