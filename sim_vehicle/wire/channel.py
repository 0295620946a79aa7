"""The impaired link between one vehicle and its ground stations.

Frames enter at one end, pass a stack of stages that can drop, delay, copy or corrupt them, and leave at the
other end at their due times. A vehicle with an unimpaired link has no channel.
"""

import heapq
import itertools
import math
from collections.abc import Callable
from enum import Enum
from typing import Protocol


class Direction(Enum):
    """Direction of a frame."""

    TO_VEHICLE = "to_vehicle"
    FROM_VEHICLE = "from_vehicle"


TimedFrames = list[tuple[bytes, float]]


class Stage(Protocol):
    """One impairment of one direction.

    Called with a frame and the time it leaves the previous stage [s]. Returns the resulting frames, each with
    the time it leaves this stage, never earlier than its arrival. A stage with `in_order` keeps frames in
    order.
    """

    @property
    def in_order(self) -> bool: ...

    def __call__(self, frame: bytes, due_s: float) -> TimedFrames: ...


class _Lane:
    """One direction: its stages and the frames in transit."""

    def __init__(self) -> None:
        self.stages: list[Stage] = []
        self.under_way: list[tuple[float, int, bytes]] = []
        self.last_due_s = -math.inf

    def due_s(self) -> float:
        return self.under_way[0][0] if self.under_way else math.inf


class Channel:
    """Both directions of one vehicle's link; without I/O and without a clock."""

    def __init__(self) -> None:
        self._lanes = {direction: _Lane() for direction in Direction}
        self._order = itertools.count()  # frames due at the same time leave in order of arrival

    def add(self, direction: Direction, stage: Stage) -> Callable[[], None]:
        """Append a stage; return a function that removes it."""
        stages = self._lanes[direction].stages
        stages.append(stage)
        return lambda: stages.remove(stage)

    def put(self, direction: Direction, frame: bytes, now: float) -> None:
        """Send one frame at `now` [s]."""
        lane = self._lanes[direction]
        passing: TimedFrames = [(frame, now)]
        for stage in lane.stages:
            passing = [left for entered in passing for left in stage(*entered)]
        # After the end of a stage, later frames must not overtake those it still holds.
        if all(stage.in_order for stage in lane.stages):
            passing = [(frame, max(due_s, lane.last_due_s)) for frame, due_s in passing]
            lane.last_due_s = max((due_s for _, due_s in passing), default=lane.last_due_s)
        for left, due_s in passing:
            self.inject(direction, left, due_s)

    def inject(self, direction: Direction, frame: bytes, due_s: float) -> None:
        """Let a frame arrive at `due_s` [s] without passing the stages (a radio's own frame)."""
        heapq.heappush(self._lanes[direction].under_way, (due_s, next(self._order), frame))

    def take(self, direction: Direction, now: float) -> TimedFrames:
        """Return the frames that arrive by `now` [s] in order of arrival, each with its time."""
        under_way = self._lanes[direction].under_way
        arrived = []
        while under_way and under_way[0][0] <= now:
            due_s, _, frame = heapq.heappop(under_way)
            arrived.append((frame, due_s))
        return arrived

    def next_due_s(self, direction: Direction | None = None) -> float:
        """Return the arrival of the next frame [s], in one direction or in any; inf if none is in transit."""
        lanes = self._lanes.values() if direction is None else (self._lanes[direction],)
        return min(lane.due_s() for lane in lanes)

    @property
    def idle(self) -> bool:
        """True without stages and frames in transit: the channel can be removed."""
        return not any(lane.stages or lane.under_way for lane in self._lanes.values())
