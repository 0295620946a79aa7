"""The source for a swarm that flies: what its vehicles tell ground stations over the bus.

Vehicles send their states each second, and copies of their observations and intents. A station does not get
what a vehicle has received of others. But each state has a combined mark of all observations that the vehicle
holds (`StateShared.knows`). So the station can tell when a vehicle holds exactly what the station has seen.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable

from swarmctl.bus import keys
from swarmctl.bus.transports.base import Transport
from swarmctl.config.scenario import Scenario
from swarmctl.core.frames import Frame, FrameCodec, IntentShared, StateShared
from swarmctl.core.observation import Observation, mark_of
from swarmctl.dashboard.model import Timeline
from swarmctl.station.watch import StateBoard

MOVES_ON_EVERY_S = 0.2
"""interval in which the time of the timeline moves on [s]"""
LACKS = (
    "cells that a vehicle has heard of from others, unless it holds all that the station knows",
    "ΣP_s and reasons of plans by the vehicles' own beliefs; those shown follow from what the station knows",
)


class BusSource:
    """The messages of a swarm, folded into a timeline. Its times count from the station's start."""

    def __init__(self, scenario: Scenario, codec: FrameCodec, now_s: float) -> None:
        """`now_s` is a monotonic time."""
        names = {spec.sysid: spec.name for spec in scenario.swarm}
        self.timeline = Timeline(scenario, "bus")
        self.timeline.lacks = LACKS
        self.board = StateBoard(scenario.config.name, names, scenario.grid, codec)
        self._swarm = scenario.config.name
        self._began_s = now_s
        self._seen: list[Observation] = []
        """all observations in the order of their arrival"""
        self._n_by_mark = {0: 0}
        """combined mark of the first n observations -> n"""
        self._mark = 0
        self._n_held: dict[int, int] = {}
        """number of the first observations that a vehicle is known to hold"""
        self._n_made: dict[int, tuple[int, int]] = {}
        """incarnation, and number of its own observations that a vehicle has made"""
        self._n_received: dict[tuple[int, int], int] = {}
        """number of observations received, by vehicle and incarnation"""

    def receive(self, key: str, payload: bytes, now_s: float, unix_s: float) -> None:
        """Fold a message to stations; the board refuses and counts all that is invalid, old or of others."""
        frame = self.board.receive(key, payload, now_s, unix_s)
        if frame is None:
            return
        uav, time_s, content = frame.sender, now_s - self._began_s, frame.content
        if uav not in self._n_made or self._n_made[uav][0] != frame.incarnation:
            self.timeline.vehicles[uav].plans.clear()  # a new start of the program numbers its plans anew
            self._n_made[uav] = frame.incarnation, 0
        if isinstance(content, StateShared):
            self._n_made[uav] = frame.incarnation, content.last_seq
            self.timeline.shared(uav, time_s, content, has_telemetry=False)
            self._compare(uav, time_s, content)
        elif isinstance(content, IntentShared):
            self.timeline.intent(uav, time_s, content, is_route=True)
        elif isinstance(content, Observation):
            self._observed(frame, content, time_s)

    def _observed(self, frame: Frame, observation: Observation, time_s: float) -> None:
        if observation.observer != frame.sender:
            return
        source = observation.source
        self._n_received[source] = self._n_received.get(source, 0) + 1
        self._seen.append(observation)
        self._mark ^= mark_of(observation)
        self._n_by_mark[self._mark] = len(self._seen)
        self.timeline.learned(frame.sender, time_s, (observation,))

    def _compare(self, uav: int, time_s: float, state: StateShared) -> None:
        """Fold what a vehicle has heard, if it holds exactly the station's first observations."""
        n, before = self._n_by_mark.get(state.knows, 0), self._n_held.get(uav, 0)
        if n > before:
            self._n_held[uav] = n
            self.timeline.learned(uav, time_s, self._seen[before:n])

    @property
    def n_missed(self) -> int:
        """Number of observations that vehicles have made and the station did not get."""
        made = ((uav, *made) for uav, made in self._n_made.items())
        return sum(max(n - self._n_received.get((uav, incarnation), 0), 0) for uav, incarnation, n in made)

    def move_on(self, network: str, now_s: float) -> None:
        """Move the timeline on, and note vehicles that fall silent; `network`: state of the connection."""
        timeline = self.timeline
        timeline.now_s = max(timeline.now_s, now_s - self._began_s)
        missed = self.n_missed
        text = [network] if network else []
        if missed:
            text.append(
                f"{missed} observations are unknown here: they were made before the dashboard began, or "
                "the network lost them [observations-missed]"
            )
        if self.board.refused:
            text.append(
                f"{self.board.refused} messages were refused: invalid, old, or of no vehicle of this swarm"
            )
        timeline.text = "; ".join(text)
        timeline.note_silence()

    async def run(
        self, bus: Transport, network: Callable[[], str], wall_clock: Callable[[], float] = time.time
    ) -> None:
        """Receive until cancelled. `network` returns the state of the connection in words."""
        clock = asyncio.get_running_loop().time

        def receive(key: str, payload: bytes) -> None:
            self.receive(key, payload, clock(), wall_clock())

        bus.subscribe(keys.station(self._swarm), receive)
        bus.subscribe(keys.copies(self._swarm), receive)
        while True:
            self.move_on(network(), clock())
            await asyncio.sleep(MOVES_ON_EVERY_S)
