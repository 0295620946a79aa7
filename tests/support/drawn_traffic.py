"""Randomly drawn traffic of light vehicles, and an independent witness of what it must never do.

The witness knows only the vehicles' true positions and modes, the configured limits, and the waiting times
that docs/traffic.md promises.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

from flights import AREA, small
from light_swarm import Air, LightAgent, LightSwarm

from swarmctl.agent.traffic.return_schedule import schedule_for
from swarmctl.agent.traffic.returning import position_for_return
from swarmctl.config.scenario import Scenario
from swarmctl.core import events as ev
from swarmctl.core.records import replace

UP_M = 1.0
HEIGHT_TOLERANCE_M = 0.3
"""accuracy of held heights, as docs/traffic.md states"""
AIR_WAIT_S, LATER_S = 300.0 + 120.0, 15.0
"""longest waits of docs/traffic.md, for a route or a descent and then for the return path, and the time to
notice and to order [s]"""
ENDS_WITHIN_S = 1500.0
LAUNCHED_S = 12.0
HOMES_APART_M = 14.0
SPOTS = 9
"""most landing spots of a goal cell"""


@dataclass
class Breach:
    pair: tuple[int, int]
    from_s: float
    until_s: float
    least_share: float

    def __str__(self) -> str:
        lasted_s = self.until_s - self.from_s
        text = f"{self.from_s:.1f} s: {self.pair} too close for {lasted_s:.1f} s"
        return f"{text}, {self.least_share:.2f} of the limits"


@dataclass
class Witness:
    swarm: LightSwarm
    excused_from_s: dict[int, float] = field(default_factory=dict)
    """times from which no rule of this program keeps a vehicle away from others"""
    breaches: list[Breach] = field(default_factory=list)
    too_long: list[str] = field(default_factory=list)
    _held_since: dict[int, float] = field(default_factory=dict)
    least_share: float = math.inf
    longest_hold_s: float = 0.0
    ordered_hold: set[int] = field(default_factory=set)
    """vehicles that hold by an operator's order, or that another station flies"""

    def look(self, now: float) -> None:
        limits = self.swarm.scenario.config.separation
        up = [a for a in self.swarm.agents if a.vehicle.armed and a.vehicle.at[2] > UP_M]
        for one, other in combinations(up, 2):
            de, dn, du = (a - b for a, b in zip(one.vehicle.at, other.vehicle.at, strict=True))
            if abs(du) >= limits.vertical_m - HEIGHT_TOLERANCE_M or abs(de) > 50.0:
                continue
            share = max(
                math.hypot(de, dn) / limits.horizontal_m, abs(du) / (limits.vertical_m - HEIGHT_TOLERANCE_M)
            )
            self.least_share = min(self.least_share, share)
            if share < 1.0 and not self._is_excused(one, other, now):
                self._note((one.uav, other.uav), now, share)
        for agent in self.swarm.agents:
            self._look_at_hold(agent, now)

    def _is_excused(self, one: LightAgent, other: LightAgent, now: float) -> bool:
        """Return whether no rule could keep two vehicles apart.

        An operator's hold may be in the way of a vehicle without a link, which nobody can stop.
        """
        pairs = (one, other), (other, one)
        in_the_way = any(
            a.uav in self.ordered_hold and a.vehicle.mode == "hold" and b.is_silent(now) for a, b in pairs
        )
        return in_the_way or any(now >= self.excused_from_s.get(a.uav, math.inf) for a in (one, other))

    def _note(self, pair: tuple[int, int], now: float, share: float) -> None:
        for breach in self.breaches:
            if breach.pair == pair and now - breach.until_s < 5.0:
                breach.until_s, breach.least_share = now, min(breach.least_share, share)
                return
        self.breaches.append(Breach(pair, now, now, share))

    def _look_at_hold(self, agent: LightAgent, now: float) -> None:
        if agent.vehicle.mode != "hold" or agent.uav in self.ordered_hold:
            self._held_since.pop(agent.uav, None)
            return
        lasted_s = now - self._held_since.setdefault(agent.uav, now)
        self.longest_hold_s = max(self.longest_hold_s, lasted_s)
        if lasted_s > AIR_WAIT_S + LATER_S:
            self.too_long.append(f"{now:.0f} s: {agent.uav} has held for {lasted_s:.0f} s")
            self._held_since[agent.uav] = math.inf


@dataclass
class DrawnTraffic:
    swarm: LightSwarm
    witness: Witness
    story: list[str] = field(default_factory=list)
    taken_over: set[int] = field(default_factory=set)
    """vehicles that another station flies; they do not follow the orders of this program"""
    ends: bool = False

    def flown(self) -> DrawnTraffic:
        self.ends = self.swarm.run(ENDS_WITHIN_S, self.witness.look)
        return self

    @property
    def findings(self) -> list[str]:
        found = [str(breach) for breach in self.witness.breaches] + self.witness.too_long
        if not self.ends:
            phases = {a.uav: (str(a.state.phase), a.vehicle.mode) for a in self.swarm.agents}
            found.append(f"the flight does not end: {phases} [deadlock]")
        for agent in self.swarm.agents:
            waits = [t for t, text in agent.said if text.endswith("[launch-waits]")]
            ends = [t for t, text in agent.said if text.endswith(("[launch-clear]", "[not-launched]"))]
            if waits and not ends and agent.state.phase.value == "standby":
                found.append(f"{agent.uav} waits on the ground since {waits[0]:.0f} s")
        return found


def draw(seed: int) -> DrawnTraffic:
    """Return the traffic of a seed."""
    rng = random.Random(seed)
    n = rng.choice([2, 2, 3, 3, 4, 4, 5, 6, 8, 12])
    scenario = _scenario(rng, seed, n)
    air = Air(rng.choice([0.0, 0.0, 0.1, 0.3]), rng.choice([0.02, 0.05, 0.3]), rng.choice([0.0, 0.0, 0.2]))
    swarm = LightSwarm(scenario, rng, air)
    drawn = DrawnTraffic(swarm, Witness(swarm))
    populate(swarm, rng, slowest_share=0.85)
    swarm.launch(rng.choice([0.0, 0.0, 2.0, 8.0]))
    for _ in range(rng.choice([0, 1, 2, 3])):
        rng.choice(_EVENTS)(drawn, rng, rng.choice(swarm.agents))
    return drawn


def populate(swarm: LightSwarm, rng: random.Random, slowest_share: float) -> float:
    """Add a drawn vehicle for each task of the scenario; return the gusts of the wind [m/s]."""
    wind = rng.choice([0.0, 0.0, 0.2, 0.4])
    for _ in swarm.scenario.tasks:
        agent = swarm.add(
            speed_share=rng.uniform(slowest_share, 1.05) if wind else 1.0,
            like_ardupilot=rng.random() < 0.5,
            gust_m_s=wind,
            rng=random.Random(rng.random()),
            boot_s=rng.uniform(10.0, 100.0),
        )
        agent.swap_s = rng.choice([0.4, 0.8, 1.5, 3.0])
    return wind


def _scenario(rng: random.Random, seed: int, n: int) -> Scenario:
    cell_m = rng.choice([40.0, 50.0])
    rows = max(rng.randint(3, 6), math.ceil(n * HOMES_APART_M / cell_m))
    cols = rng.randint(3, 6)
    cells = [(r, c) for r in range(rows) for c in range(cols)]
    wall_col = rng.randrange(1, cols - 1) if rng.random() < 0.5 else None
    gap = rng.randrange(rows)
    walls = [c for c in cells if c[1] == wall_col and abs(c[0] - gap) > 0]
    known = rng.random() < 0.5
    hostiles = walls if not known else rng.sample(cells, rng.randint(0, 2))
    config: dict[str, Any] = {
        "seed": seed,
        "area": {**AREA, "rows": rows, "cols": cols, "cell_size_m": cell_m}
        | ({"no_fly": [list(c) for c in walls]} if known else {}),
        "threats": {"count": len(hostiles), "hostiles": [list(c) for c in hostiles]},
        "planner": {"w": rng.choice([0.2, 0.5, 0.9])},
        "flight": {
            "altitude_m": rng.choice([12.0, 16.0]),
            "altitude_step_m": rng.choice([0.0, 0.0, 1.5, 3.5, 5.0]),
            "any_angle": rng.random() < 0.3,
            "on_exit": "return",
        },
        "separation": {"action": rng.choice(["hold", "hold", "climb"])},
        "simulate": {"count": n, "ready_s": 0.0, "start_distance_m": rng.choice([20.0, 40.0])},
    }
    if rng.random() < 0.2:
        config["arrival"] = {"mode": "simultaneous", "tolerance_s": 3}
    scenario = small(**config)
    free = [c for c in cells if c not in walls and c not in hostiles]
    n_goals = max(rng.choice([1, 1, 2, 3]), math.ceil(n / SPOTS))
    far = [c for c in free if c[1] >= cols // 2]
    goals = rng.sample(far if len(far) >= n_goals else free, n_goals)
    chosen = [goals[i % len(goals)] for i in range(n)]
    tasks = tuple(
        replace(
            task,
            goals=(goal,),
            landing_index=sum(other == goal for other in chosen[:i]),
            landing_count=chosen.count(goal),
        )
        for i, (task, goal) in enumerate(zip(scenario.tasks, chosen, strict=True))
    )
    return replace(scenario, tasks=tasks)


# --- events


def tell(drawn: DrawnTraffic, at_s: float, text: str, action: Callable[[], None]) -> None:
    drawn.story.append(f"{at_s:.1f} s: {text}")
    drawn.swarm.at(at_s, action)


def recall(drawn: DrawnTraffic, rng: random.Random, _agent: LightAgent) -> None:
    """Recall all vehicles in turns, as the shutdown does: hold, then return by the schedule."""
    at_s = rng.uniform(LAUNCHED_S, 60.0)
    agents = drawn.swarm.agents

    def hold() -> None:
        for agent in agents:
            drawn.witness.ordered_hold.add(agent.uav)
            agent(ev.OperatorCommand(ev.FlightOrder.HOLD))

    def give_turns() -> None:
        places = {a.uav: position_for_return(a.state) for a in agents if not a.state.ended}
        turns = schedule_for({uav: place for uav, place in places.items() if place is not None})
        for agent in agents:
            after_s = turns.begins_s.get(agent.uav, turns.all_landed_s)
            agent(ev.OperatorCommand(ev.FlightOrder.RETURN, after_s=after_s))

    tell(drawn, at_s, "recall", hold)
    drawn.swarm.at(at_s + 8.0, give_turns)


def order(drawn: DrawnTraffic, rng: random.Random, agent: LightAgent) -> None:
    order = rng.choice([ev.FlightOrder.HOLD, ev.FlightOrder.RETURN, ev.FlightOrder.LAND])
    at_s = rng.uniform(LAUNCHED_S, 60.0)

    def give(order: ev.FlightOrder) -> None:
        if order is ev.FlightOrder.HOLD:
            drawn.witness.ordered_hold.add(agent.uav)
        else:
            drawn.witness.ordered_hold -= {agent.uav} - drawn.taken_over
        agent(ev.OperatorCommand(order))

    tell(drawn, at_s, f"{order} ordered of {agent.uav}", lambda: give(order))
    if order is ev.FlightOrder.HOLD:
        later_s = at_s + rng.choice([10.0, 60.0, 400.0])
        then = rng.choice([ev.FlightOrder.RESUME, ev.FlightOrder.RETURN])
        tell(drawn, later_s, f"{then} ordered of {agent.uav}", lambda: give(then))
        if then is ev.FlightOrder.RESUME:
            drawn.swarm.at(later_s + 20.0, lambda: _sent_home_if_holding(agent, give))


def _sent_home_if_holding(agent: LightAgent, give: Callable[[ev.FlightOrder], None]) -> None:
    # A repeated order would end the wait for a clear return path.
    if agent.state.phase.value == "holding" and not agent.state.is_waiting:
        give(ev.FlightOrder.RETURN)


def low_battery(drawn: DrawnTraffic, rng: random.Random, agent: LightAgent) -> None:
    """The battery falls below 25 % (returns, may wait) or 18 % (urgent return)."""
    percent = rng.choice([24.0, 24.0, 18.0])

    def sag() -> None:
        agent.vehicle.battery_percent = percent

    tell(drawn, rng.uniform(LAUNCHED_S, 60.0), f"battery of {agent.uav} at {percent:g} %", sag)


def lost_link(drawn: DrawnTraffic, rng: random.Random, agent: LightAgent) -> None:
    at_s, for_s = rng.uniform(LAUNCHED_S, 60.0), rng.choice([2.0, 6.0, 20.0])
    agent.silent.append((at_s, at_s + for_s))
    drawn.story.append(f"{at_s:.1f} s: no link to {agent.uav} for {for_s:g} s")


def mute(drawn: DrawnTraffic, rng: random.Random, agent: LightAgent) -> None:
    at_s, for_s = rng.uniform(LAUNCHED_S, 60.0), rng.choice([3.0, 10.0, 30.0])
    drawn.swarm.air.mute.setdefault(agent.uav, []).append((at_s, at_s + for_s))
    drawn.story.append(f"{at_s:.1f} s: {agent.uav} is mute for {for_s:g} s")


def refusals(drawn: DrawnTraffic, rng: random.Random, agent: LightAgent) -> None:
    at_s, for_s = rng.uniform(LAUNCHED_S, 60.0), rng.choice([2.0, 5.0])
    agent.failing.append((at_s, at_s + for_s))
    drawn.story.append(f"{at_s:.1f} s: {agent.uav} takes no commands for {for_s:g} s")


def taken_over(
    drawn: DrawnTraffic, agent: LightAgent, at_s: float, for_s: float, *, by_pilot: bool = False
) -> None:
    """Another station, or a pilot, stops a vehicle in the air and flies it home later."""
    vehicle, who = agent.vehicle, "a pilot" if by_pilot else "another station"

    def stop() -> None:
        if not vehicle.armed or (by_pilot and vehicle.is_descending):
            return
        drawn.witness.ordered_hold.add(agent.uav)
        drawn.taken_over.add(agent.uav)
        if by_pilot:
            agent.pilot_since_s = drawn.swarm.now
            vehicle.take_over()
        else:
            vehicle.hold()

    def home() -> None:
        if vehicle.armed and vehicle.mode == ("pilot" if by_pilot else "hold"):
            drawn.witness.excused_from_s[agent.uav] = drawn.swarm.now
            vehicle.return_home()

    tell(drawn, at_s, f"{who} stops {agent.uav}", stop)
    tell(drawn, at_s + for_s, f"{who} brings {agent.uav} home", home)


def _taken_over(drawn: DrawnTraffic, rng: random.Random, agent: LightAgent) -> None:
    taken_over(drawn, agent, rng.uniform(LAUNCHED_S, 60.0), rng.choice([30.0, 400.0]))


_EVENTS = [recall, order, order, low_battery, lost_link, mute, refusals, _taken_over]
