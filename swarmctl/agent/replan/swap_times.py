"""The last swaps of a vehicle: their durations and stops as measured, and their failures. Pure."""

from __future__ import annotations

import math

import msgspec

from swarmctl.core.records import replace

N_KEPT = 3
"""number of last swaps with stored durations; the longest stored duration is expected"""
PRIOR_S = 1.5
"""least expected duration before the first measurement [s]"""
MARGIN_S = 0.5
"""constant margin over the measured duration [s]: positions come 4 or 5 times a second"""
MARGIN_SHARE = 0.25
"""margin as a share of the measured duration: links and plans differ"""
MAX_EXPECTED_S = 60.0
"""greatest duration that is assumed after an upload or a late swap [s]"""
MAX_STANDSTILL_S = 0.3
"""longest standstill that does not count as a stop [s]; in telemetry a slow turn may look the same"""


class SwapTimes(msgspec.Struct, frozen=True):
    """Durations of one vehicle's last swaps, by the vehicle's clock."""

    took_s: tuple[float, ...] = ()
    """times from the decision to the flight by the new plan [s]"""
    stood_s: tuple[float, ...] = ()
    """times for which the vehicle held or stood still [s]"""
    prior_s: float = PRIOR_S
    """expected duration before the first measurement [s]"""
    least_s: float = 0.0
    """least expected duration after a late swap; half of it after each swap in time [s]"""

    @classmethod
    def expecting(cls, takes_s: float) -> SwapTimes:
        """Return the expectation for a vehicle on the ground, from the duration of its upload."""
        return cls(prior_s=min(max(_with_margin_s(takes_s), PRIOR_S), MAX_EXPECTED_S))

    def measured(self, took_s: float, stood_s: float) -> SwapTimes:
        """Return these times with one more swap."""
        durations_s, stops_s = (*self.took_s, took_s)[-N_KEPT:], (*self.stood_s, stood_s)[-N_KEPT:]
        return SwapTimes(durations_s, stops_s, self.prior_s, 0.5 * self.least_s)

    def too_late(self, took_s: float) -> SwapTimes:
        """Return these times after a late swap that has taken `took_s` until then [s].

        Twice the expected duration is expected from now on, at most MAX_EXPECTED_S.
        """
        least_s = min(2.0 * self.expected_s, MAX_EXPECTED_S)
        return replace(self, took_s=(*self.took_s, took_s)[-N_KEPT:], least_s=least_s)

    @property
    def expected_s(self) -> float:
        """Expected duration with a margin [s]; the vehicle flies by its old plan for this time."""
        return max(_with_margin_s(max(self.took_s)) if self.took_s else self.prior_s, self.least_s)

    @property
    def likely_s(self) -> float:
        """Longest of the last durations [s]; `prior_s` before the first measurement."""
        return max(self.took_s, default=self.prior_s)

    @property
    def stop_s(self) -> float | None:
        """Expected standstill [s]; 0 for a vehicle that flies on, None before the first measurement."""
        if not self.stood_s:
            return None
        longest_s = max(self.stood_s)
        return longest_s if longest_s > MAX_STANDSTILL_S else 0.0


class SwapHistory(msgspec.Struct, frozen=True):
    """The last mission changes of one vehicle; times are by the vehicle's clock."""

    decided_boot_s: float = -math.inf
    """time of the last decision for a mission change"""
    done_boot_s: float = -math.inf
    """time of the last mission change in flight"""
    braking_until_boot_s: float = -math.inf
    """end of the braking that the last mission change in flight causes"""
    n_failed: int = 0
    """number of failed mission changes since the last success; late changes do not count"""

    def done(self, boot_s: float, braking_until_boot_s: float) -> SwapHistory:
        """Return the history after a mission change in flight."""
        return replace(self, done_boot_s=boot_s, braking_until_boot_s=braking_until_boot_s)

    def failed(self, *, is_late: bool) -> SwapHistory:
        """Return the history after a failed mission change."""
        return replace(self, n_failed=self.n_failed + (not is_late))


def _with_margin_s(took_s: float) -> float:
    return (1.0 + MARGIN_SHARE) * took_s + MARGIN_S
