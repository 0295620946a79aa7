"""The wire between one vehicle and its ground stations, when something is wrong with it.

Frames go in at one end, pass a stack of stages that may lose, hold, copy or spoil them, and come out at the
other end when they are due. A vehicle whose wire is sound has no channel at all.
"""

import heapq
import itertools
import math
from collections.abc import Callable
from enum import Enum
from typing import Protocol


class Direction(Enum):
    """Which way a frame travels."""

    TO_VEHICLE = "to_vehicle"
    FROM_VEHICLE = "from_vehicle"


TimedFrames = list[tuple[bytes, float]]


class Stage(Protocol):
    """One thing that is wrong with one direction.

    Called with a frame and the time it leaves the stage before [s]; returns what becomes of it: frames, each
    with the time it leaves this stage, never earlier than it came. A stage that is `in_order` keeps frames in
    order.
    """

    @property
    def in_order(self) -> bool: ...

    def __call__(self, frame: bytes, due_s: float) -> TimedFrames: ...


class _Lane:
    """One direction: its stages and what is under way."""

    def __init__(self) -> None:
        self.stages: list[Stage] = []
        self.under_way: list[tuple[float, int, bytes]] = []
        self.last_due_s = -math.inf

    def due_s(self) -> float:
        return self.under_way[0][0] if self.under_way else math.inf


class Channel:
    """Both directions of one vehicle's wire; without I/O and without a clock of its own."""

    def __init__(self) -> None:
        self._lanes = {direction: _Lane() for direction in Direction}
        self._order = itertools.count()  # frames due at the same time leave as they came

    def add(self, direction: Direction, stage: Stage) -> Callable[[], None]:
        """Put a stage behind those that are there; returns what takes it out again."""
        stages = self._lanes[direction].stages
        stages.append(stage)
        return lambda: stages.remove(stage)

    def put(self, direction: Direction, frame: bytes, now: float) -> None:
        """Send one frame at `now` [s]."""
        lane = self._lanes[direction]
        passing: TimedFrames = [(frame, now)]
        for stage in lane.stages:
            passing = [left for entered in passing for left in stage(*entered)]
        # A stage that has ended must not let later frames overtake those it still holds.
        if all(stage.in_order for stage in lane.stages):
            passing = [(frame, max(due_s, lane.last_due_s)) for frame, due_s in passing]
            lane.last_due_s = max((due_s for _, due_s in passing), default=lane.last_due_s)
        for left, due_s in passing:
            self.inject(direction, left, due_s)

    def inject(self, direction: Direction, frame: bytes, due_s: float) -> None:
        """Let a frame arrive at `due_s` [s] that no stage has seen (a radio's own)."""
        heapq.heappush(self._lanes[direction].under_way, (due_s, next(self._order), frame))

    def take(self, direction: Direction, now: float) -> TimedFrames:
        """What has arrived by `now` [s], in order of arrival, each with the time of its arrival."""
        under_way = self._lanes[direction].under_way
        arrived = []
        while under_way and under_way[0][0] <= now:
            due_s, _, frame = heapq.heappop(under_way)
            arrived.append((frame, due_s))
        return arrived

    def next_due_s(self, direction: Direction | None = None) -> float:
        """When the next frame arrives [s], in one direction or in any; inf where nothing is under way."""
        lanes = self._lanes.values() if direction is None else (self._lanes[direction],)
        return min(lane.due_s() for lane in lanes)

    @property
    def idle(self) -> bool:
        """Nothing is wrong and nothing is under way: the channel can go."""
        return not any(lane.stages or lane.under_way for lane in self._lanes.values())
