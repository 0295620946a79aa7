"""Results of procedures."""

from __future__ import annotations

from typing import Literal

import msgspec

from swarmctl.core.events import MissionAccepted, MissionFailed, PlanAfterFailure

FlyingAfterSwap = Literal["new", "old", "hold", "theirs", "unknown"]
"""mission or mode after a swap; theirs: another mode, set by the pilot, a failsafe or another station"""


class Done(msgspec.Struct, frozen=True):
    """Result of a procedure; `failure` is None after a success."""

    failure: str | None = None


class LaunchBlocked(Done, frozen=True):
    """Result of a launch that another vehicle blocked; the vehicle is on the ground, disarmed."""

    was_armed: bool = False
    """True if the vehicle was armed and has been disarmed again"""


class Uploaded(Done, frozen=True):
    """Result of an upload on the ground."""

    swap_takes_s: float = 0.0
    """expected time of a swap over this link, estimated from the time of this upload [s]"""


class Swapped(Done, frozen=True):
    """Result of a swap, and the mission or mode that the vehicle flies now."""

    flying: FlyingAfterSwap = "unknown"
    stood_still_s: float = 0.0
    """time in hold or without motion in the air during the swap, by the vehicle's clock [s]"""
    took_s: float | None = None
    """time until the new plan was current, by the vehicle's clock [s]; None: the new plan is not flown"""
    is_late: bool = False
    """True if the vehicle had passed the splice point or left the route; plan a splice point farther ahead"""

    def event(self, plan_id: int) -> MissionAccepted | MissionFailed:
        """Return the event for an agent that has ordered the swap to this plan."""
        if self.failure is None:
            return MissionAccepted(plan_id, self.took_s, self.stood_still_s)
        # A new mission that is not confirmed is unknown.
        flying: PlanAfterFailure = "unknown" if self.flying == "new" else self.flying
        now_flies = {
            "old": "the vehicle flies its old mission",
            "hold": "the vehicle holds",
            "theirs": "the pilot, a failsafe or another station has set the mode",
            "unknown": "the flown mission is unknown",
        }
        text = f"mission change failed; {now_flies[flying]}. Cause: {self.failure}"
        return MissionFailed(plan_id, flying, text, self.stood_still_s, self.is_late)
