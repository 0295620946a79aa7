"""The fold of the dashboard: what a source delivers becomes a timeline, and a timeline gives pictures.

All sources of timelines call the same methods. Nothing here reads a clock, a file or the bus. A timeline
stores each change with its time, so a picture at any time is a bisection, during a flight too. Times are
seconds since the begin of the record, or since the station joined.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmctl.agent.phases import ENDED
from swarmctl.config.scenario import Scenario
from swarmctl.core.belief import weighed_occupancy
from swarmctl.core.exposure import exposure
from swarmctl.core.frames import IntentShared, MemberShared, StateShared
from swarmctl.core.messages import CommunicationRange
from swarmctl.core.observation import BeliefItem, Observation
from swarmctl.core.operator_text import printable
from swarmctl.core.planned_mission import PlannedMission
from swarmctl.core.records import replace
from swarmctl.core.threat import FiringStrength
from swarmctl.core.vehicle import VehicleState
from swarmctl.dashboard import announced, conflicts, events, motions, picture_parts
from swarmctl.dashboard.belief_history import BeliefHistory, Name
from swarmctl.dashboard.facts import Motion, SentIntent, VehicleFacts, Words
from swarmctl.dashboard.history import EachSecond, Items
from swarmctl.dashboard.picture import (
    SILENT_AFTER_S,
    AreaPicture,
    Event,
    Learned,
    Picture,
    RouteChange,
    Severity,
    ShownRoute,
    SourceKind,
    SourceState,
    Strike,
)
from swarmctl.report.summary import MIN_STEP_M

EVERYBODY = ""
"""the name under which the belief of all vehicles together is asked for"""
_encode = msgspec.msgpack.Encoder().encode


class Timeline:
    """Everything known of one swarm, from the first time to the last."""

    def __init__(self, scenario: Scenario, kind: SourceKind) -> None:
        self.area: AreaPicture = picture_parts.area(scenario)
        self.kind: SourceKind = kind
        self.is_live = self.is_flight
        self.now_s = 0.0
        """time to show if none is chosen; a live source moves it on, though no data come"""
        self.end_s = 0.0
        """time of the newest data"""
        self.total_s = 0.0
        """length of the record, if it is known before all of it is read"""
        self.text = ""
        """state of the source, in words"""
        self.lacks: tuple[str, ...] = ()
        self.version = 0
        """number that grows with new data"""
        self.scenario = scenario
        self.vehicles = {
            spec.sysid: VehicleFacts(spec.name, spec.sysid, BeliefHistory(scenario.prior, spec.sysid))
            for spec in scenario.swarm
        }
        self._by_name = {vehicle.name: vehicle for vehicle in self.vehicles.values()}
        self.common = BeliefHistory(scenario.prior, None)
        self.observations: dict[Name, tuple[Observation, float]] = {}
        """each observation, and the time of the first word of it"""
        self.events: Items[Event] = Items()
        self.changes: Items[RouteChange] = Items()
        self.acknowledged: set[int] = set()
        """numbers of the alarms that a person has acknowledged"""
        self.strikes: Items[Strike] = Items()
        self._conflicts = EachSecond(lambda time_s: conflicts.predicted(self, time_s))
        self._hearing = EachSecond(lambda time_s: picture_parts.hearing(self, time_s))
        self._exposures: dict[str, tuple[object, NDArray[np.float64]]] = {}

    @property
    def is_flight(self) -> bool:
        """True for a flight that was in progress, though it may have ended since."""
        return self.kind in ("live file", "bus")

    # --- the fold

    def _touch(self, time_s: float) -> float:
        """Note new data, and return their time: at least that of the newest data before."""
        self.version += 1
        self.end_s = max(self.end_s, time_s)
        self.now_s = max(self.now_s, self.end_s)
        return self.end_s

    def telemetry(self, uav: int, time_s: float, state: VehicleState) -> None:
        """Fold a vehicle's telemetry, as its agent gets it."""
        time_s, vehicle = self._touch(time_s), self.vehicles[uav]
        vehicle.word_s.append(time_s)
        self._say(vehicle, time_s, mode=state.mode, armed=state.armed, lost_since_s=None)
        self._move(vehicle, time_s, motions.of_telemetry(vehicle.motion.last, state))

    def shared(self, uav: int, time_s: float, state: StateShared, *, has_telemetry: bool) -> None:
        """Fold the state that a vehicle tells each second; `has_telemetry`: its positions come otherwise."""
        time_s, vehicle = self._touch(time_s), self.vehicles[uav]
        vehicle.word_s.append(time_s)
        for other in state.hears:
            self.heard(uav, other, time_s)
        w, strength = None, None
        if state.weights is not None:
            with contextlib.suppress(ValueError):  # no firing strengths: another program's mistake
                w, strength = state.weights[0], FiringStrength(*state.weights[1:])
        self._say(
            vehicle,
            time_s,
            phase=printable(state.phase),
            mode=printable(state.mode) or vehicle.words.last.mode,
            outcome=printable(state.outcome),
            trouble=printable(state.trouble),
            waiting=printable(state.waits),
            group=printable(state.group),
            replans=state.replans,
            n_observed=state.n_observed,
            n_found=state.n_found,
            **({} if w is None else {"w": w, "strength": strength}),
        )
        if not has_telemetry:
            self._move(vehicle, time_s, motions.of_word(vehicle.motion.last, state))
        elif vehicle.motion.last.to_go_m != state.to_go_m:
            self._move(vehicle, time_s, vehicle.motion.last._replace(to_go_m=state.to_go_m))
        flown = vehicle.plans.get(state.plan_id)
        if flown is not None or state.plan_id == 0:
            vehicle.route.add(time_s, flown)

    def member(self, uav: int, time_s: float, told: MemberShared) -> None:
        """Fold what a member tells its group."""
        time_s, vehicle = self._touch(time_s), self.vehicles[uav]
        if told.joins:
            leads = told.route_id != 0
            self._say(vehicle, time_s, leads=leads, place_error_m=round(told.error_m))
        else:
            self._say(vehicle, time_s, leads=False, place_error_m=None, group="")

    def learned(self, uav: int, time_s: float, items: Iterable[BeliefItem]) -> None:
        """Fold observations that a vehicle has made or received."""
        time_s, items = self._touch(time_s), tuple(items)
        self.vehicles[uav].beliefs.learn(time_s, items)
        self.common.learn(time_s, items)
        for item in items:
            if isinstance(item, Observation):
                name = (item.observer, item.incarnation, item.seq)
                self.observations.setdefault(name, (item, time_s))

    def planned(self, uav: int, time_s: float, mission: PlannedMission) -> None:
        """Fold the decision for a new plan."""
        time_s, vehicle = self._touch(time_s), self.vehicles[uav]
        new = picture_parts.route(self.scenario.grid, mission)
        self._change_route(vehicle, time_s, new, mission.because)

    def chosen(self, uav: int, time_s: float, new: ShownRoute) -> None:
        """Fold a route that a vehicle flies from now on, without an upload."""
        time_s, vehicle = self._touch(time_s), self.vehicles[uav]
        self._change_route(vehicle, time_s, new, ())
        vehicle.route.add(time_s, new)

    def _change_route(
        self, vehicle: VehicleFacts, time_s: float, new: ShownRoute, names: Iterable[Name]
    ) -> None:
        vehicle.plans[new.plan_id] = new
        because = tuple(map(self._learned, names))
        old = vehicle.route.last
        change = RouteChange(time_s, vehicle.name, old, new, because)
        self.changes.add(time_s, change)
        self._event(vehicle.name, time_s, "info", events.of_change(change))

    def _learned(self, name: Name) -> Learned:
        found, observer = self.observations.get(name), self.vehicles.get(name[0])
        return Learned(
            f"vehicle {name[0]}" if observer is None else observer.name, None if found is None else found[1]
        )

    def accepted(self, uav: int, time_s: float, plan_id: int) -> None:
        """Fold that a plan is on the vehicle."""
        time_s, vehicle = self._touch(time_s), self.vehicles[uav]
        if plan_id in vehicle.plans:
            vehicle.route.add(time_s, vehicle.plans[plan_id])

    def not_accepted(self, uav: int, time_s: float, plan_id: int, reason: str) -> None:
        """Fold that a mission change has failed."""
        time_s, vehicle = self._touch(time_s), self.vehicles[uav]
        self._event(vehicle.name, time_s, "warning", f"plan {plan_id} did not get onto the vehicle: {reason}")

    def intent(self, uav: int, time_s: float, intent: IntentShared, *, is_route: bool) -> None:
        """Fold the flight that a vehicle announces; `is_route`: its plans do not come otherwise."""
        time_s, vehicle = self._touch(time_s), self.vehicles[uav]
        vehicle.intents.add(time_s, SentIntent(vehicle.motion.last.boot_s, _encode(intent)))
        if is_route and intent.plan_id and intent.points:
            route = vehicle.plans.get(intent.plan_id)
            if route is None:
                p_s = self.exposure(vehicle.name, time_s)
                route = announced.route(self.scenario.grid, intent, p_s)
                because = announced.because(self, vehicle, route)
                self._change_route(vehicle, time_s, route, because)
            vehicle.route.add(time_s, route)

    def heard(self, receiver: int, sender: int, time_s: float, *, is_intent: bool = False) -> None:
        """Fold that a message of `sender` arrived at `receiver`; intents tell the loss."""
        if sender not in self.vehicles or receiver not in self.vehicles or sender == receiver:
            return
        vehicle = self.vehicles[receiver]
        vehicle.heard_s[sender].append(time_s)
        if is_intent:
            vehicle.intents_heard_s[sender].append(time_s)

    def weights(
        self,
        uav: int,
        time_s: float,
        w: float | None,
        strength: FiringStrength | None,
        reach: CommunicationRange | None = None,
    ) -> None:
        """Fold an operator's new weights and range of communication."""
        time_s, vehicle = self._touch(time_s), self.vehicles[uav]
        said = vehicle.words.last
        self._say(
            vehicle,
            time_s,
            w=said.w if w is None else w,
            strength=said.strength if strength is None else strength,
            range=said.range if reach is None else reach,
        )

    def link_lost(self, uav: int, time_s: float, age_s: float) -> None:
        """Fold a report of a lost link; it comes again each second."""
        time_s, vehicle = self._touch(time_s), self.vehicles[uav]
        if vehicle.words.last.lost_since_s is not None:
            return
        self._say(vehicle, time_s, lost_since_s=time_s - age_s)
        self._event(vehicle.name, time_s, "alarm", f"no telemetry for {age_s:.0f} s: the link is lost")

    def link_restored(self, uav: int, time_s: float) -> None:
        time_s, vehicle = self._touch(time_s), self.vehicles[uav]
        self._say(vehicle, time_s, lost_since_s=None)
        self._event(vehicle.name, time_s, "info", "telemetry arrives again")

    def note(self, name: str, time_s: float, text: str) -> None:
        """Fold a text for the operator."""
        self._event(name, self._touch(time_s), "warning", printable(text))

    def note_silence(self) -> None:
        """Add an alarm for each vehicle that has fallen silent, and a line for each that is heard again."""
        for vehicle in self.vehicles.values():
            last_s = vehicle.word_s[-1] if vehicle.word_s else None
            may_end = vehicle.words.last.phase in ENDED  # the agent of a vehicle that has ended may stop
            is_silent = last_s is not None and not may_end and self.now_s - last_s > SILENT_AFTER_S
            if is_silent and not vehicle.is_silent:
                self._event(
                    vehicle.name, self.now_s, "alarm", f"no word for {SILENT_AFTER_S:g} s [vehicle-silent]"
                )
            elif vehicle.is_silent and not is_silent:
                self._event(vehicle.name, self.now_s, "info", "heard again")
            vehicle.is_silent = is_silent

    # --- parts of the fold

    def _event(self, name: str, time_s: float, severity: Severity, text: str) -> None:
        self.events.add(time_s, Event(len(self.events.items) + 1, time_s, name, severity, text))

    def _say(self, vehicle: VehicleFacts, time_s: float, **changes: Any) -> None:
        before = vehicle.words.last
        for key, value in changes.items():
            if getattr(before, key) != value:
                break
        else:
            return
        after = replace(before, **changes)
        vehicle.words.add(time_s, after)
        for severity, text in events.of_words(before, after, is_bus=self.kind == "bus"):
            self._event(vehicle.name, time_s, severity, text)

    def _move(self, vehicle: VehicleFacts, time_s: float, row: Motion) -> None:
        before = vehicle.motion.last
        vehicle.motion.add(time_s, row)
        here, armed = row.lat_lon, vehicle.words.last.armed
        if here is None:
            return
        is_flying = (row.height_m or 0.0) > MIN_STEP_M if armed is None else armed
        if is_flying and here != before.lat_lon:
            place, last = self.scenario.grid.frame.to_local(*here), vehicle.track.items
            if not last or math.dist(last[-1], place) >= MIN_STEP_M:
                vehicle.track.add(time_s, place)
        new = int((row.strikes or 0) - (before.strikes or 0))
        if new > 0:
            place = self.scenario.grid.frame.to_local(*here)
            self.strikes.add(time_s, Strike(time_s, vehicle.name, place, new))
            self._event(vehicle.name, time_s, "alarm", events.of_strikes(new, int(row.strikes or 0)))

    # --- pictures

    def at(self, time_s: float | None = None, whose: str = EVERYBODY) -> Picture:
        """Return the picture at a time, with the belief of a vehicle or of EVERYBODY; None: now."""
        time_s = self.now_s if time_s is None else min(max(time_s, 0.0), self.now_s)
        vehicles = tuple(picture_parts.vehicle(self, v, time_s) for v in self.vehicles.values())
        history = self._beliefs(whose)
        return Picture(
            time_s,
            self.source,
            vehicles,
            whose,
            history.belief(history.version(time_s)).codes,
            self._hearing.at(time_s, self.end_s, self.version),
            self._conflicts.at(time_s, self.end_s, self.version),
            self.events.until(time_s),
            self.changes.until(time_s),
            self.strikes.until(time_s),
            picture_parts.groups(self, time_s),
        )

    @property
    def source(self) -> SourceState:
        age_s = self.now_s - self.end_s if self.is_live else 0.0
        total_s = max(self.total_s, self.end_s)
        return SourceState(self.kind, self.is_live, self.now_s, total_s, age_s, self.text, self.lacks)

    def vehicle(self, name: str) -> VehicleFacts:
        """Return the histories of a vehicle. Raises KeyError."""
        return self._by_name[name]

    def words(self, name: str, time_s: float) -> Words:
        """Return the words of a vehicle at a time; EVERYBODY has none."""
        return self.vehicle(name).words.at(time_s) if name else Words()

    def strength(self, name: str, time_s: float) -> FiringStrength:
        """Return the firing strengths by which a vehicle plans; those of the configuration for EVERYBODY."""
        strength = self.words(name, time_s).strength
        return self.scenario.strength if strength is None else strength

    def exposure_key(self, name: str, time_s: float) -> tuple[str, int, FiringStrength]:
        """Return a value that is equal for two times with the same `exposure`."""
        return name, self._beliefs(name).version(time_s), self.strength(name, time_s)

    def exposure(self, name: str, time_s: float | None = None) -> NDArray[np.float64]:
        """Return P_s of each cell (Eq. 2-4) by a vehicle's belief, or by that of EVERYBODY; read-only."""
        time_s = self.now_s if time_s is None else time_s
        key, cached = self.exposure_key(name, time_s), self._exposures.get(name)
        if cached is None or cached[0] != key:
            p_s = exposure(self.occupancy(name, time_s), self.strength(name, time_s))
            p_s.flags.writeable = False
            cached = self._exposures[name] = key, p_s
        return cached[1]

    def occupancy(self, name: str, time_s: float) -> NDArray[np.float64]:
        """Return the probability of each cell to be occupied, by which a vehicle or EVERYBODY plans."""
        history = self._beliefs(name)
        version = history.version(time_s)
        belief = history.belief(version).belief
        autonomy = self.scenario.config.planner.autonomy
        if name and autonomy > 0.0:
            return weighed_occupancy(belief, history.own_belief(version), autonomy)
        return belief.occupancy()

    def _beliefs(self, name: str) -> BeliefHistory:
        return self.vehicle(name).beliefs if name else self.common
