"""Randomly drawn flights: a small swarm, its network, and events at drawn times."""

from __future__ import annotations

import asyncio
import contextlib
import random
import signal
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from flights import AREA, STATION, small
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from trouble import Trouble, another_station_sends, mode_message

from sim_vehicle.fleet import Fleet
from sim_vehicle.vehicle.behaviour import Behaviour
from swarmctl.bus.transports.memory import MemoryBus
from swarmctl.config.scenario import Scenario
from swarmctl.core.messages import GiveOrder
from swarmctl.station import client, commands

KINDS = ("ardupilot", "px4")
WINGED = (*KINDS, "arduplane", "px4plane")
FROM_S, UNTIL_S = 3.0, 90.0
"""earliest and latest start of an event: until all vehicles would have arrived"""
LAUNCHED_S = 12.0
"""earliest operator's order: a vehicle held on the ground stays there, and its flight would not end"""
ANSWERS_S = 40.0
"""longest time for which an operator's order is tried"""
DOWN_AFTER_S = 90.0
"""time after which another station lands a vehicle that it has taken over"""
EXCUSED = frozenset({"reboot", "gps_loss", "gps_glitch", "stuck_mode"})
"""faults after which no ground station can prevent a crash or a loss of separation"""


@dataclass
class RandomFlight:
    """A randomly drawn flight."""

    scenario: Scenario
    trouble: Trouble
    bus: MemoryBus = field(default_factory=MemoryBus)
    story: list[str] = field(default_factory=list)
    """the events in words"""
    excused: set[int] = field(default_factory=set)
    """vehicles with a fault, or flown by another station"""
    foreign: set[int] = field(default_factory=set)
    """vehicles that get another station's mission"""
    ordered_s: dict[int, list[float]] = field(default_factory=dict)
    """times of an operator's orders by vehicle"""
    asked: list[asyncio.Task[Any]] = field(default_factory=list)

    def at(self, at_s: float, text: str, action: Callable[[Fleet], None]) -> None:
        self.story.append(f"{at_s:.1f} s: {text}")
        self.trouble.actions.append((at_s, action))


def draw(seed: int) -> RandomFlight:
    """Return the flight of a seed."""
    rng = random.Random(seed)
    winged = rng.random() < 0.2
    n = rng.randint(2, 3)
    autopilots = rng.choices(WINGED if winged else KINDS, k=n)
    drawn = RandomFlight(_scenario(rng, seed, autopilots, winged=winged), Trouble())
    if rng.random() < 0.2:
        drawn.trouble.wind = {"speed_m_s": rng.uniform(2.0, 10.0), "from_deg": rng.uniform(0.0, 360.0)}
    for _ in range(rng.randint(2, 6)):
        rng.choice(_EVENTS)(drawn, rng, rng.randint(1, n))
    return drawn


def _scenario(rng: random.Random, seed: int, autopilots: Sequence[str], *, winged: bool) -> Scenario:
    rows = 12 if winged else rng.randint(4, 7)
    cols = 12 if winged else rng.randint(6, 8)
    simulate: dict[str, Any] = {"count": len(autopilots), "ready_s": 3.0, "autopilot": list(autopilots)}
    if winged:
        simulate["start_distance_m"] = 150.0
    elif rng.random() < 0.5:
        simulate["goal"] = [rng.randrange(rows), cols - 1]
    return small(
        seed=seed,
        area={**AREA, "rows": rows, "cols": cols},
        threats={"count": rng.randint(0, rows * cols // 8)},
        planner={"w": rng.choice([0.2, 0.5, 0.9])},
        communication=_network(rng, len(autopilots)),
        flight={
            "altitude_m": 30.0 if winged else 12.0,
            "altitude_step_m": 8.0 if winged else rng.choice([1.5, 5.0]),
            "any_angle": winged or rng.random() < 0.3,
            "on_exit": rng.choice(["return", "land"]),
        },
        separation={"action": rng.choice(["hold", "climb"])},
        simulate=simulate,
    )


def _network(rng: random.Random, n: int) -> dict[str, Any]:
    models: list[dict[str, Any]] = [
        {},
        {},
        {"delay_s": rng.choice([0.2, 1.0]), "jitter_s": 0.3},
        {"loss": rng.choice([0.05, 0.3])},
        {"range": rng.randint(0, n - 1), "relay": True},
        {"max_distance_m": 150.0},
        {"partitions": [{"from_s": 20.0, "until_s": 50.0, "groups": [[1], list(range(2, n + 1))]}]},
    ]
    return {"bus": "memory", **rng.choice(models)}


# --- events


def _fault(drawn: RandomFlight, rng: random.Random, uav: int) -> None:
    lasts_s = rng.choice([2.0, 8.0, 30.0])
    name, params, for_s = rng.choice(
        [
            ("link_outage", {}, lasts_s),
            ("one_way", {"dead": rng.choice(["to_vehicle", "from_vehicle"])}, lasts_s),
            ("packet_loss", {"rate": 0.3}, None),
            ("delay", {"delay_s": rng.choice([0.2, 0.6, 1.5])}, None),
            ("duplication", {"rate": 0.3, "gap_s": rng.choice([0.0, 2.0])}, None),
            ("reordering", {"rate": 0.2, "hold_s": rng.choice([0.2, 3.0])}, None),
            ("absent_ack", {}, lasts_s),
            ("slow_ack", {"delay_s": 2.0}, lasts_s),
            ("mission_refused", {"at_item": rng.choice([None, 3])}, lasts_s),
            ("battery_sag", {"at_most": rng.choice([0.22, 0.15, 0.08]), "sag_v": 0.0}, None),
            ("stuck_mode", {}, lasts_s),
            ("gps_loss", {}, rng.choice([4.0, None])),
            ("gps_glitch", {"east_m": rng.uniform(-40.0, 40.0)}, lasts_s),
            ("reboot", {"silence_s": rng.choice([0.5, 5.0])}, None),
        ]
    )
    at_s = rng.uniform(FROM_S, UNTIL_S)
    fault = {"fault": name, "params": params, "vehicles": [uav], "at_s": at_s}
    drawn.trouble.faults.append(fault if for_s is None else {**fault, "for_s": for_s})
    drawn.story.append(f"{at_s:.1f} s: {name} of {uav} {params} for {for_s}")
    if name in EXCUSED:
        drawn.excused.add(uav)


def _other_station(drawn: RandomFlight, rng: random.Random, uav: int) -> None:
    """Another station selects a mode and may give the vehicle back, or clears its mission.

    Later it lands the vehicle.
    """
    at_s = rng.uniform(FROM_S, UNTIL_S)
    drawn.excused.add(uav)
    # Without its mission, in which its landing is, ArduPlane would circle over home for ever.
    if rng.random() < 0.3 and drawn.scenario.tasks[uav - 1].wings is None:
        drawn.foreign.add(uav)
        drawn.at(at_s, f"another station empties the mission of {uav}", lambda fleet: _empties(fleet, uav))
    else:
        mode = rng.choice([Behaviour.RETURN, Behaviour.HOLD, Behaviour.LAND, Behaviour.MISSION])
        drawn.at(at_s, f"another station has {uav} {mode.name}", lambda fleet: _chooses(fleet, uav, mode))
        if rng.random() < 0.4:
            back_s = at_s + rng.choice([0.3, 5.0])
            back = Behaviour.MISSION
            drawn.at(back_s, f"and gives {uav} back", lambda fleet: _chooses(fleet, uav, back))
    down_s = at_s + DOWN_AFTER_S
    drawn.at(down_s, f"and calls {uav} home", lambda fleet: _chooses(fleet, uav, Behaviour.RETURN))


def _chooses(fleet: Fleet, uav: int, behaviour: Behaviour) -> None:
    personality = fleet.vehicles[fleet.sysids.index(uav)].personality
    if all(mode.behaviour is not behaviour for mode in personality.modes.by_number.values()):
        behaviour = Behaviour.RETURN  # ArduPlane has no mode that lands
    another_station_sends(fleet, mode_message(uav, personality.modes.of(behaviour).number))


def _empties(fleet: Fleet, uav: int) -> None:
    another_station_sends(fleet, mavlink.MAVLink_mission_count_message(uav, 1, 0, 0))


def _operator(drawn: RandomFlight, rng: random.Random, uav: int) -> None:
    """Give up to three orders, possibly contradictory, to one vehicle or all; after a hold all return."""
    at_s, order = rng.uniform(LAUNCHED_S, UNTIL_S), ""
    for _ in range(rng.randint(1, 3)):
        order = rng.choice(["hold", "return", "land", "launch"])
        _order(drawn, at_s, order, rng.choice([None, (uav,)]))
        at_s += rng.choice([0.0, 0.3, 2.0, 15.0])
    if order == "hold":
        _order(drawn, at_s + 30.0, "return", None)


def _order(drawn: RandomFlight, at_s: float, order: Any, uavs: tuple[int, ...] | None) -> None:
    async def give() -> None:
        with contextlib.suppress(client.NoValidAnswer):  # the flight is over
            await commands.ask(drawn.bus, STATION, GiveOrder(uavs, order))

    def action(_fleet: Fleet) -> None:
        drawn.asked.append(asyncio.get_running_loop().create_task(give()))

    for uav in uavs or [task.uav for task in drawn.scenario.tasks]:
        drawn.ordered_s.setdefault(uav, []).append(at_s)
    drawn.at(at_s, f"{order} ordered of {uavs or 'all'}", action)


def _ctrl_c(drawn: RandomFlight, rng: random.Random, _uav: int) -> None:
    """Press Ctrl-C once or twice."""
    at_s = rng.uniform(FROM_S, UNTIL_S)
    for later_s in (0.0, 8.0) if rng.random() < 0.3 else (0.0,):
        drawn.at(at_s + later_s, "Ctrl-C", lambda _fleet: signal.raise_signal(signal.SIGINT))


_EVENTS = [*[_fault] * 6, *[_other_station] * 2, *[_operator] * 2, _ctrl_c]
