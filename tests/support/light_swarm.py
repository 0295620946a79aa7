"""Agents with light vehicles on one clock: the parts of runner, link and network that traffic depends on."""

from __future__ import annotations

import heapq
import itertools
import math
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from agent_stories import check_accepted
from light_vehicle import LightVehicle

from swarmctl.agent.phases import ON_GROUND
from swarmctl.agent.replan.mission_changes import needs_tick
from swarmctl.agent.state import AgentState, initial_state
from swarmctl.agent.step import step
from swarmctl.agent.traffic.neighbours import relevant_states
from swarmctl.config.scenario import Scenario
from swarmctl.core import events as ev
from swarmctl.core.frames import IntentShared, MemberShared, StateShared
from swarmctl.core.grid import Cell
from swarmctl.core.observation import Observation
from swarmctl.core.planned_mission import PlannedMission
from swarmctl.core.records import replace
from swarmctl.mavlink.telemetry.presence import LOST_EVERY_S

STEP_S = 0.125
TELEMETRY_EVERY = 2
"""steps between two telemetry messages"""
NEIGHBOURS_EVERY_S = 0.5
LOST_AFTER_S = 3.0
"""silence after which the link counts as lost [s]"""
CONFIRMS_AFTER_S, ORDER_FAILS_AFTER_S = 0.6, 4.0
"""time after which telemetry confirms an order, at the earliest and at the latest [s]"""
ORDER_EVERY_S = 1.0
"""time after which the link sends an order again that the vehicle has not answered [s]"""
STOPS_WITHIN_S = 7.0
"""time in which a vehicle with a new link is stopped, or has climbed away from the place [s]"""
KINDS = (StateShared, IntentShared, MemberShared)
"""messages of which only the newest of a sender counts"""


@dataclass
class Air:
    """The network between the agents."""

    loss: float = 0.0
    delay_s: float = 0.05
    jitter_s: float = 0.0
    mute: dict[int, list[tuple[float, float]]] = field(default_factory=dict)
    """times in which a vehicle neither sends nor receives"""

    def carries(self, uav: int, now: float) -> bool:
        return not any(since <= now < until for since, until in self.mute.get(uav, ()))


class LightAgent:
    """One agent with its vehicle and its link."""

    def __init__(self, swarm: LightSwarm, index: int, vehicle: LightVehicle, boot_s: float) -> None:
        self.swarm, self.vehicle, self.boot_s = swarm, vehicle, boot_s
        self.task = swarm.scenario.tasks[index]
        self.state: AgentState = initial_state(self.task, swarm.scenario.prior)
        self.said: list[tuple[float, str]] = []
        self.silent: list[tuple[float, float]] = []
        """times without a link to the vehicle"""
        self.failing: list[tuple[float, float]] = []
        """times in which the vehicle takes no order and no mission"""
        self.swap_s = 1.0
        self._job = 0
        self._conflict = ""
        self._lost_s = -math.inf
        self._contact_s = 0.0
        self._read_s = -1.0
        self._seen: Cell | None = None
        self._newest: dict[type, dict[int, tuple[float, Any]]] = {kind: {} for kind in KINDS}
        """(time of sending [s], message) by type and sender"""
        self._unread: dict[type, set[int]] = {kind: set() for kind in KINDS}
        self.pilot_since_s = math.inf
        """time from which a pilot flies the vehicle"""
        self.after_takeover: list[tuple[float, str]] = []
        """(time, name) of each effect for the vehicle after the telemetry had shown a pilot's mode"""
        self._pilot_seen_s = math.inf

    @property
    def uav(self) -> int:
        return self.task.uav

    def __call__(self, event: ev.Event) -> None:
        self.state, effects = step(self.state, event, self.swarm.now)
        for effect in effects:
            self._perform(effect)

    def make_ready(self) -> None:
        self.report()
        self(ev.Ready())
        self.tick()

    def tick(self) -> None:
        if needs_tick(self.state, self.swarm.now):
            self(ev.Tick())

    # --- effects

    def _perform(self, effect: ev.Effect) -> None:
        if self.swarm.now > self._pilot_seen_s and _is_own_command(effect):
            self.after_takeover.append((self.swarm.now, type(effect).__name__))
        match effect:
            case ev.Publish(message, _, group):
                self.swarm.publish(self.uav, message, group)
            case ev.SendSetPoint(setpoint):
                self.vehicle.take_setpoint(setpoint)
            case ev.SetSpeed(speed_m_s):
                self._begin(lambda job: self._later(job, 0.2, lambda: self._set_speed(speed_m_s)))
            case ev.SwapMission(mission):
                self._begin(lambda job: self._swap(mission, job))
            case ev.Command(order):
                self._begin(lambda job: self._order(order, job, self.swarm.now + ORDER_FAILS_AFTER_S))
            case ev.LaunchConflict(text):
                self._conflict = text
            case ev.Release():
                self._job += 1
            case ev.NotifyOperator(text):
                self.said.append((self.swarm.now, text))
            case _:
                pass

    def _begin(self, work: Callable[[int], None]) -> None:
        self._job += 1
        work(self._job)

    def _later(self, job: int, after_s: float, action: Callable[[], None]) -> None:
        """Go on with a job unless another has replaced it."""

        def resume() -> None:
            if self._job == job:
                action()
                self.tick()

        self.swarm.at(self.swarm.now + after_s, resume)

    def is_silent(self, now: float) -> bool:
        """Return whether the vehicle has no link, or has it again for less than STOPS_WITHIN_S."""
        return any(since <= now < until + STOPS_WITHIN_S for since, until in self.silent)

    def _reaches(self) -> bool:
        now = self.swarm.now
        return not any(a <= now < b for a, b in (*self.silent, *self.failing))

    def _swap(self, swap: PlannedMission, job: int) -> None:
        if self.state.phase in ON_GROUND:
            self._later(job, 0.3, lambda: self._upload(swap))
            return
        began_s = self.swarm.now
        self._later(job, self.swap_s, lambda: self._take(swap, began_s))

    def _upload(self, swap: PlannedMission) -> None:
        self.vehicle.set_mission(swap.plan)
        self(ev.MissionAccepted(swap.plan_id, self.swap_s))

    def _take(self, swap: PlannedMission, began_s: float) -> None:
        vehicle, plan = self.vehicle, swap.plan
        if not self._reaches():
            flying: ev.PlanAfterFailure = "hold" if vehicle.mode == "hold" else "old"
            self(ev.MissionFailed(swap.plan_id, flying, "no answer"))
        elif vehicle.is_descending or vehicle.mode not in ("mission", "hold", "takeoff"):
            self(ev.MissionFailed(swap.plan_id, "old", "the vehicle is landing"))
        elif plan.leaves_ahead and plan.track and vehicle.passed(*self._local(plan.track[0])):
            self(ev.MissionFailed(swap.plan_id, "old", "too late", is_late=True))
        else:
            vehicle.set_mission(plan)
            self(ev.MissionAccepted(swap.plan_id, self.swarm.now - began_s))

    def _local(self, point: Any) -> tuple[float, float]:
        return self.task.grid.frame.to_local(point.lat_deg, point.lon_deg)

    def _set_speed(self, speed_m_s: float) -> None:
        if self._reaches() and self.vehicle.mode == "mission":
            self.vehicle.commanded_m_s = speed_m_s
        else:
            self(ev.SpeedFailed("no answer"))

    def _order(self, order: ev.FlightOrder, job: int, until_s: float) -> None:
        if order is ev.FlightOrder.LAUNCH:
            self._later(job, 0.5, lambda: self._arm(job))
            return
        if not self._reaches():
            if self.swarm.now < until_s:
                self._later(job, ORDER_EVERY_S, lambda: self._order(order, job, until_s))
            else:
                self(ev.OrderFailed(order, "no answer"))
            return
        if order is ev.FlightOrder.FORMATION:
            self._later(job, self.swarm.rng.uniform(0.1, 0.5), lambda: self._follow_setpoints(job))
            return
        act = {
            ev.FlightOrder.HOLD: self.vehicle.hold,
            ev.FlightOrder.RETURN: self.vehicle.return_home,
            ev.FlightOrder.LAND: self.vehicle.land,
        }[order]
        delay_s = self.swarm.rng.uniform(0.1, 0.5)

        def act_if_flying() -> None:
            if self.vehicle.armed and self.vehicle.mode != "pilot":
                act()

        self._later(job, delay_s, act_if_flying)
        self._confirm(job, order, self.swarm.now + delay_s)

    def _follow_setpoints(self, job: int) -> None:
        order = ev.FlightOrder.FORMATION
        if not self.vehicle.follow_setpoints():
            self(ev.OrderFailed(order, "the mode is refused"))
            return
        self._confirm(job, order, self.swarm.now)

    def _confirm(self, job: int, order: ev.FlightOrder, followed_s: float) -> None:
        """Report an order as done once telemetry shows it, or as failed."""

        def look() -> None:
            if self._contact_s > followed_s:
                self(ev.OrderDone(order))
            elif self.swarm.now - followed_s < ORDER_FAILS_AFTER_S:
                self._later(job, CONFIRMS_AFTER_S, look)
            else:
                self(ev.OrderFailed(order, "no answer"))

        self._later(job, followed_s - self.swarm.now + CONFIRMS_AFTER_S, look)

    def _arm(self, job: int) -> None:
        if self._conflict:
            self(ev.LaunchPostponed(self._conflict))
            return
        self.vehicle.arm()
        self._later(job, 1.0, lambda: self._take_off(job))

    def _take_off(self, job: int) -> None:
        if self._conflict:
            self.vehicle.disarm()
            self(ev.LaunchPostponed(self._conflict, was_armed=True))
            return
        self.vehicle.take_off()
        self._later(job, 1.5, lambda: self(ev.OrderDone(ev.FlightOrder.LAUNCH)))

    # --- events

    def receive(self, uav: int, message: Any, sent_s: float) -> None:
        """Pass on observations; keep the newest of other messages, with the route of an earlier one."""
        if not isinstance(message, KINDS):
            self(ev.ObservationsReceived((message,)))
            return
        newest = self._newest[type(message)]
        earlier_s, earlier = newest.get(uav, (-math.inf, message))
        if earlier_s > sent_s and not isinstance(message, StateShared):
            return
        if isinstance(message, MemberShared):
            message = message.with_route_of(earlier)
        newest[uav] = (sent_s, message)
        self._unread[type(message)].add(uav)

    def _take_new(self, kind: type, now: float) -> tuple[tuple[int, float, Any], ...]:
        """Return (sender, age [s], message) of the messages of a type since the last call."""
        new = [(uav, *self._newest[kind][uav]) for uav in sorted(self._unread[kind])]
        self._unread[kind].clear()
        return tuple((uav, now - sent_s, message) for uav, sent_s, message in new)

    def report(self) -> None:
        """Pass on the vehicle's telemetry with what the others sent, as the runner does."""
        now = self.swarm.now
        if any(since <= now < until for since, until in self.silent):
            silent_s = now - self._contact_s
            if silent_s > LOST_AFTER_S and now - self._lost_s >= LOST_EVERY_S:
                self._lost_s = now
                self(ev.LinkLost(silent_s))
            return
        self._contact_s = now
        if self._lost_s > -math.inf:
            self._lost_s = -math.inf
            self(ev.LinkRestored())
        vehicle = self.vehicle.telemetry(self.boot_s + now)
        telemetry = ev.TelemetryReceived(vehicle, self._take_new(MemberShared, now))
        if now - self._read_s >= NEIGHBOURS_EVERY_S:
            self._read_s = now
            telemetry = replace(
                telemetry,
                neighbours=relevant_states(self.state, self._take_new(StateShared, now)),
                intents=self._take_new(IntentShared, now),
            )
        self(telemetry)
        if now >= self.pilot_since_s:
            self._pilot_seen_s = min(self._pilot_seen_s, now)
        self._sense()
        self.tick()

    def _sense(self) -> None:
        here = self.state.cell
        if here is None or here == self._seen or self.vehicle.at[2] < 2.0:
            return
        self._seen = here
        grid, hostiles = self.task.grid, self.swarm.scenario.hostiles
        around = itertools.product((-1, 0, 1), repeat=2)
        cells = ((here[0] + dr, here[1] + dc) for dr, dc in around)
        self(
            ev.Observed(
                tuple(
                    (r, c, (r, c) in hostiles) for r, c in cells if 0 <= r < grid.rows and 0 <= c < grid.cols
                )
            )
        )


class LightSwarm:
    def __init__(self, scenario: Scenario, rng: random.Random, air: Air, step_s: float = STEP_S) -> None:
        self.scenario, self.rng, self.air, self.step_s = scenario, rng, air, step_s
        self.now = 0.0
        self.agents: list[LightAgent] = []
        self._due: list[tuple[float, int, Callable[[], None]]] = []
        self._numbers = itertools.count()

    def add(
        self,
        *,
        speed_share: float = 1.0,
        like_ardupilot: bool = True,
        gust_m_s: float = 0.0,
        rng: random.Random,
        boot_s: float = 10.0,
        kind: type[LightVehicle] = LightVehicle,
    ) -> LightAgent:
        """Add the vehicle of the next task with its agent, ready from the start."""
        index = len(self.agents)
        task, spec = self.scenario.tasks[index], self.scenario.specs[index]
        frame, speed_m_s = task.grid.frame, task.speed_m_s * speed_share
        vehicle = kind(
            frame,
            frame.to_local(*spec.start),
            300.0,
            speed_m_s,
            task.altitude_m,
            like_ardupilot,
            gust_m_s,
            rng,
        )
        agent = LightAgent(self, index, vehicle, boot_s)
        self.agents.append(agent)
        self.at(0.0, agent.make_ready)
        return agent

    def launch(self, stagger_s: float = 0.0) -> None:
        """Order the launch of the vehicles one after another."""
        order = ev.OperatorCommand(ev.FlightOrder.LAUNCH)
        for i, agent in enumerate(self.agents):
            self.at(1.0 + i * stagger_s, partial(agent, order))

    def at(self, at_s: float, action: Callable[[], None]) -> None:
        heapq.heappush(self._due, (at_s, next(self._numbers), action))

    def publish(self, sender: int, message: Any, group: tuple[int, ...] = ()) -> None:
        """Send a message to the other vehicles; `group`: the only receivers, if there are any."""
        check_accepted(message)
        if not self.air.carries(sender, self.now):
            return
        sent_s = self.now
        for agent in self.agents:
            # Observations arrive in any case: the real network repeats lost ones.
            lost = self.rng.random() < self.air.loss and not isinstance(message, Observation)
            is_receiver = agent.uav != sender and (not group or agent.uav in group)
            if not is_receiver or lost or not self.air.carries(agent.uav, self.now):
                continue
            after_s = self.air.delay_s + self.rng.uniform(0.0, self.air.jitter_s)
            self.at(sent_s + after_s, lambda a=agent: a.receive(sender, message, sent_s))  # type: ignore[misc]

    def run(self, until_s: float, watch: Callable[[float], None]) -> bool:
        """Fly until all flights have ended; return False if one has not ended by `until_s`."""
        n_steps = 0
        while self.now < until_s:
            self.now += self.step_s
            n_steps += 1
            while self._due and self._due[0][0] <= self.now:
                heapq.heappop(self._due)[2]()
            for i, agent in enumerate(self.agents):
                agent.vehicle.step(self.step_s)
                if (n_steps + i) % TELEMETRY_EVERY == 0:
                    agent.report()
            watch(self.now)
            if all(agent.state.ended and not agent.vehicle.armed for agent in self.agents):
                return True
        return False


def _is_own_command(effect: ev.Effect) -> bool:
    """Return whether the effect reaches the vehicle without an operator's order."""
    if isinstance(effect, ev.Command):
        return not effect.by_person
    return isinstance(effect, ev.SwapMission | ev.SetSpeed | ev.SendSetPoint)
