"""The plans of one vehicle: the mission flown, the one being uploaded, and the need for a new plan. Pure.

Only the methods here change the record; other modules name the change.
"""

from __future__ import annotations

import math

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmctl.agent.replan.swap_times import SwapHistory, SwapTimes
from swarmctl.core import events as ev
from swarmctl.core.observation import ObservationId
from swarmctl.core.planned_mission import PlannedMission
from swarmctl.core.records import replace
from swarmctl.planners.base import Route


class Plans(msgspec.Struct, frozen=True):
    mission: PlannedMission | None = None
    """mission being flown, or to be flown after the launch; None while a hold on the route interrupts it"""
    accepted: PlannedMission | None = None
    """last mission verified on the vehicle, flown or not"""
    pending: PlannedMission | None = None
    """mission being uploaded"""
    is_due: bool = False
    """True: the agent has to decide on a plan"""
    must_change: bool = False
    """True: the next plan is flown even if it is no better"""
    because: tuple[ObservationId, ...] = ()
    """names of the observations merged since the last decision, and those of a failed mission change"""
    retry_at_s: float = -math.inf
    """earliest next decision, by the run's clock"""
    exposure: NDArray[np.float64] | None = None
    """P_s as of the last decision, (rows, cols)"""
    route_exposure: NDArray[np.float64] | None = None
    """P_s at the last decision to keep or take the route being flown, (rows, cols)"""
    planned: Route | None = None
    """last answer of the planner, flown or not"""
    late_s: float | None = None
    """predicted arrival after take-off [s], by the last decision; None while within the bound"""
    hold_is_own: bool = False
    """True if this agent or its swap has set the hold between two plans"""
    next_plan_id: int = 1
    searches: int = 0
    replans: int = 0
    """number of mission changes in flight"""
    swaps: SwapHistory = msgspec.field(default_factory=SwapHistory)
    swap_times: SwapTimes = msgspec.field(default_factory=SwapTimes)

    # --- the need for a decision

    def due(self, because: tuple[ObservationId, ...] = (), *, must_change: bool = False) -> Plans:
        """Return the plans of a vehicle that has to decide; `because` are the names of new observations."""
        return replace(
            self,
            is_due=True,
            because=(*self.because, *because),
            must_change=self.must_change or must_change,
        )

    def not_due(self) -> Plans:
        """Return the plans of a vehicle that needs no decision now."""
        return replace(self, is_due=False)

    def not_before(self, retry_at_s: float) -> Plans:
        """Return the plans with an earliest time of the next decision, by the run's clock [s]."""
        return replace(self, retry_at_s=retry_at_s)

    # --- a decision

    def searched(self, p_s: NDArray[np.float64], planned: Route, late_s: float | None) -> Plans:
        """Return the plans after a search by the exposure `p_s`."""
        searches = self.searches + 1
        return replace(self, exposure=p_s, planned=planned, late_s=late_s, searches=searches, is_due=False)

    def searched_beside(self, *, must_change: bool) -> Plans:
        """Return the plans after a search that only shows that another search has to follow."""
        return replace(self, searches=self.searches + 1, must_change=self.must_change or must_change)

    def kept(self, p_s: NDArray[np.float64]) -> Plans:
        """Return the plans after the decision to keep the route by the exposure `p_s`."""
        return replace(self, exposure=p_s, route_exposure=p_s, is_due=False, because=())

    def observed(self, p_s: NDArray[np.float64]) -> Plans:
        """Return the plans of a vehicle off its route that knows the exposure `p_s` now."""
        return replace(self, exposure=p_s, is_due=False, because=())

    def changing_to(self, mission: PlannedMission, boot_s: float) -> Plans:
        """Return the plans after the decision for a new plan, at `boot_s` by the vehicle's clock."""
        swaps = replace(self.swaps, decided_boot_s=boot_s)
        return replace(self.uploading(mission), because=(), must_change=False, swaps=swaps)

    def uploading(self, mission: PlannedMission) -> Plans:
        """Return the plans while a mission is being uploaded."""
        return replace(self, pending=mission, next_plan_id=max(self.next_plan_id, mission.plan_id + 1))

    def deferred(self, before: Plans, because: tuple[ObservationId, ...]) -> Plans:
        """Return the plans after a decision whose plan is tried again; `before`: those at the decision."""
        return replace(
            self,
            pending=None,
            because=because,
            is_due=True,
            must_change=before.must_change,
            late_s=before.late_s,
            swaps=before.swaps,
        )

    def unreachable(self) -> Plans:
        """Return the plans after a search without a route to a goal."""
        return replace(self, is_due=False, because=())

    # --- the outcome of a mission change

    def verified(self, mission: PlannedMission) -> Plans:
        """Return the plans after the vehicle has accepted a mission."""
        return replace(self, accepted=mission, pending=None)

    def taken(self, mission: PlannedMission) -> Plans:
        """Return the plans of a vehicle that flies, or will fly, an accepted mission."""
        return replace(self.afresh(), mission=mission, route_exposure=self.exposure, hold_is_own=False)

    def changed_in_flight(
        self, boot_s: float, braking_until_boot_s: float, took_s: float | None, stood_s: float
    ) -> Plans:
        """Return the plans after a mission change in flight, which took `took_s` [s] if measured."""
        times = self.swap_times if took_s is None else self.swap_times.measured(took_s, stood_s)
        swaps = self.swaps.done(boot_s, braking_until_boot_s)
        return replace(self, replans=self.replans + 1, swaps=swaps, swap_times=times)

    def uploaded_on_ground(self, took_s: float | None) -> Plans:
        """Return the plans after an upload on the ground, which took `took_s` [s] if measured."""
        return self if took_s is None else replace(self, swap_times=SwapTimes.expecting(took_s))

    def failed(self, event: ev.MissionFailed, boot_s: float) -> Plans:
        """Return the plans after a failed mission change, at `boot_s` by the vehicle's clock."""
        swaps = self.swaps.failed(is_late=event.is_late)
        times = (
            self.swap_times.too_late(boot_s - self.swaps.decided_boot_s) if event.is_late else self.swap_times
        )
        return replace(self, pending=None, swaps=swaps, swap_times=times, hold_is_own=event.flying == "hold")

    def again(self, mission: PlannedMission, retry_at_s: float, *, flies_old: bool) -> Plans:
        """Return the plans that follow the failure of `mission`: a new decision from `retry_at_s` on.

        A vehicle that no longer flies its old mission has none, so it takes any new plan.
        """
        return replace(
            self,
            is_due=True,
            because=(*mission.because, *self.because),
            retry_at_s=retry_at_s,
            mission=self.mission if flies_old else None,
        )

    # --- orders

    def interrupted(self) -> Plans:
        """Return the plans of a vehicle whose mission a hold interrupts."""
        return self.without_mission().not_due().not_before(-math.inf)

    def without_mission(self) -> Plans:
        """Return the plans of a vehicle that leaves its mission."""
        return replace(self, mission=None)

    def with_mission(self, mission: PlannedMission | None) -> Plans:
        """Return the plans of a vehicle that goes on by an interrupted mission."""
        return replace(self, mission=mission)

    def resumed(self) -> Plans:
        """Return the plans of a vehicle in its agent's own hold, which needs a new plan."""
        return self.from_own_hold().due()

    def from_own_hold(self) -> Plans:
        """Return the plans of a vehicle that an upload begins from its agent's own hold."""
        return replace(self, hold_is_own=True)

    def without_upload(self) -> Plans:
        """Return the plans after an upload that was given up."""
        return replace(self, pending=None)

    def afresh(self) -> Plans:
        """Return the plans as if no mission change had failed before."""
        return replace(self, swaps=replace(self.swaps, n_failed=0))

    def forgotten(self) -> Plans:
        """Return the plans of a vehicle whose mission is unknown again."""
        return replace(self, mission=None, pending=None)
