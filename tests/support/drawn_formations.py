"""Randomly drawn flights of groups in formation, and an independent witness of what they must never do.

The witness of `drawn_traffic` knows members like any other vehicles. It is joined here by what set-points
add: nobody is left in a mode that needs them, nobody fights a pilot, and every vehicle ends.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field
from typing import Any

import drawn_traffic as traffic
from drawn_traffic import LATER_S, LAUNCHED_S, SPOTS, DrawnTraffic, Witness, populate
from flights import AREA, small
from light_swarm import Air, LightAgent, LightSwarm
from light_vehicle import STOPS_AFTER_S

from swarmctl.config.formations_checks import check_groups
from swarmctl.config.scenario import Scenario
from swarmctl.core.records import replace

ENDS_WITHIN_S = 1500.0
START_SPACING_M = 20.0
CELL_M = 50.0
STEP_S = 0.1
"""half of the time between two telemetry messages, each of which brings a set-point [s]"""
ABANDONED_S = 30.0
"""time after which somebody brings home a released vehicle that hovers [s]"""


@dataclass
class FormationWitness(Witness):
    def look(self, now: float) -> None:
        super().look(now)
        for agent in self.swarm.agents:
            vehicle = agent.vehicle
            unheard = any(since <= now < until + LATER_S for since, until in agent.silent)
            waits = vehicle.mode == "setpoints" and vehicle.setpoint_age_s > STOPS_AFTER_S + LATER_S
            if waits and not unheard:
                self.too_long.append(f"{now:.0f} s: {agent.uav} waits for set-points that nobody sends")
                vehicle.hold()  # one finding for each time


@dataclass
class DrawnFormation(DrawnTraffic):
    released_s: dict[int, float] = field(default_factory=dict)

    def flown(self) -> DrawnFormation:
        self.ends = self.swarm.run(ENDS_WITHIN_S, self._look)
        return self

    def _look(self, now: float) -> None:
        self.witness.look(now)
        for agent in self.swarm.agents:
            vehicle = agent.vehicle
            if not agent.state.ended or not vehicle.armed or vehicle.mode not in ("hold", "setpoints"):
                continue
            self.witness.ordered_hold.add(agent.uav)
            if now - self.released_s.setdefault(agent.uav, now) > ABANDONED_S:
                self.witness.excused_from_s[agent.uav] = now
                vehicle.return_home()

    @property
    def findings(self) -> list[str]:
        found = super().findings
        for agent in self.swarm.agents:
            for at_s, name in agent.after_takeover[:1]:
                n = len(agent.after_takeover)
                found.append(f"{at_s:.1f} s: {name} to {agent.uav} after a pilot's takeover, {n} in all")
        return found


def draw(seed: int) -> DrawnFormation:
    """Return the flight of a seed."""
    rng = random.Random(seed)
    scenario = _scenario(rng, seed)
    while list(check_groups(scenario)):
        scenario = _scenario(rng, seed)
    air = Air(rng.choice([0.0, 0.0, 0.1, 0.3]), rng.choice([0.02, 0.1, 0.3]), rng.choice([0.0, 0.0, 0.2]))
    swarm = LightSwarm(scenario, rng, air, STEP_S)
    drawn = DrawnFormation(swarm, FormationWitness(swarm))
    wind = populate(swarm, rng, slowest_share=0.9)
    section = scenario.config.formations[0]
    shapes = [section.shape.kind] + ([section.narrow_shape.kind] if section.narrow_shape else [])
    heights, n = section.heights, len(section.members)
    drawn.story.append(
        f"{n} of {len(swarm.agents)} by {section.approach}: {shapes}, {section.shape.spacing_m:.0f} m, "
        f"{heights}, split {section.split_factor}, {section.lost_member}; {air}, wind {wind}"
    )
    swarm.launch(rng.choice([0.0, 0.0, 2.0]))
    for _ in range(rng.choice([0, 1, 1, 2, 3])):
        member = swarm.agents[0] if rng.random() < 0.3 else rng.choice(swarm.agents)
        rng.choice(_EVENTS)(drawn, rng, member)
    return drawn


def _scenario(rng: random.Random, seed: int) -> Scenario:
    n = rng.choice([2, 2, 3, 3, 3, 4, 4, 5, 6, 8])
    n_single = min(rng.choice([0, 0, 1, 2]), SPOTS - n)
    rows = max(rng.randint(4, 6), math.ceil((n + n_single) * START_SPACING_M / CELL_M))
    cols = rng.randint(6, 9)
    goal_row, has_gap = rng.randrange(1, rows - 1), rng.random() < 0.4
    goal, gap_row, wall_col = (goal_row, cols - 1), rng.randrange(1, rows - 1), rng.randint(3, cols - 3)
    walls = [(row, wall_col) for row in range(rows) if row != gap_row] if has_gap else []
    free = [(r, c) for r in range(rows) for c in range(1, cols) if (r, c) != goal and (r, c) not in walls]
    known = rng.random() < 0.7
    hostiles = rng.sample(free, rng.randint(0, 2)) + ([] if known else walls)
    config: dict[str, Any] = {
        "seed": seed,
        "area": {**AREA, "rows": rows, "cols": cols, "cell_size_m": CELL_M}
        | ({"no_fly": [list(c) for c in walls]} if known and walls else {}),
        "threats": {"count": len(hostiles), "hostiles": [list(c) for c in hostiles]},
        "planner": {"w": rng.choice([0.2, 0.5, 0.9])},
        "flight": {
            "altitude_m": rng.choice([12.0, 16.0]),
            "altitude_step_m": rng.choice([0.0, 1.5, 3.6]),
            "on_exit": "return",
        },
        "simulate": {
            "count": n + n_single,
            "ready_s": 0.0,
            "speed_m_s": rng.choice([8.0, 10.0, 14.0]),
            "start_spacing_m": START_SPACING_M,
            "start_distance_m": rng.choice([20.0, 40.0]),
            "goal": list(goal),
        },
        "formations": [_group(rng, n, has_gap)],
    }
    # A generator of its own, so that the other draws of a seed are those of campaigns without splits.
    more, (group,) = random.Random(seed), config["formations"]
    if group["heights"] == "stepped" and config["flight"]["altitude_step_m"] > 3.5 and more.random() < 0.7:
        group["split_factor"] = more.choice([1.0, 1.05, 1.2])
    scenario = small(**config)
    spots = rng.sample(free, n_single)
    tasks = tuple(
        task if i < n else replace(task, goals=(spots[i - n],), landing_index=0, landing_count=1)
        for i, task in enumerate(scenario.tasks)
    )
    return replace(scenario, tasks=tasks)


def _group(rng: random.Random, n: int, has_gap: bool) -> dict[str, Any]:
    spacing_m = rng.choice([12.0, 15.0, 20.0, 30.0])
    kind = rng.choice(["wedge", "wedge", "line", "column", "circle"])
    heights = rng.choice(["stepped", "level"])
    step_m = rng.choice([0.0, 0.0, 1.0]) if heights == "level" else 0.0
    group: dict[str, Any] = {
        "name": "alpha",
        "members": [f"uav{i}" for i in range(1, n + 1)],
        "approach": rng.choice(["leader_following", "virtual_structure", "behavioural"]),
        "shape": {"kind": kind, "spacing_m": spacing_m, "height_step_m": step_m},
        "heights": heights,
        "lost_member": rng.choice(["close_up", "leave_open"]),
    }
    if has_gap and kind != "column":
        group["narrow_shape"] = {"kind": "column", "spacing_m": spacing_m, "height_step_m": step_m}
    if group["approach"] == "behavioural":
        group["options"] = {"null_space": rng.random() < 0.5}
    return group


def _taken_over(drawn: DrawnTraffic, rng: random.Random, agent: LightAgent) -> None:
    at_s, for_s = rng.uniform(LAUNCHED_S, 80.0), rng.choice([20.0, 120.0])
    traffic.taken_over(drawn, agent, at_s, for_s, by_pilot=True)


_EVENTS = [
    traffic.recall,
    traffic.order,
    traffic.order,
    traffic.low_battery,
    traffic.lost_link,
    traffic.lost_link,
    traffic.mute,
    traffic.mute,
    traffic.refusals,
    _taken_over,
    _taken_over,
]
