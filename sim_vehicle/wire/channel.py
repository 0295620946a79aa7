"""The impaired link between one vehicle and its ground stations.

Frames pass a list of stages and leave the channel at their due times. A stage can drop, delay, copy or
corrupt frames. A vehicle with an unimpaired link has no channel.
"""

import heapq
import itertools
import math
from collections.abc import Callable
from enum import Enum


class Direction(Enum):
    """Direction of a frame."""

    TO_VEHICLE = "to_vehicle"
    FROM_VEHICLE = "from_vehicle"


TimedFrames = list[tuple[bytes, float]]


# One impairment of one direction. A stage takes a frame and the time at which the frame leaves the previous
# stage [s], and returns the frames that leave this stage, each with its time [s], never earlier.
Stage = Callable[[bytes, float], TimedFrames]


class _Lane:
    """One direction: its stages and the frames in transit."""

    def __init__(self) -> None:
        self.stages: list[tuple[Stage, bool]] = []  # with True for a stage that keeps the order
        self.in_transit: list[tuple[float, int, bytes]] = []  # heap of due time [s], number, frame
        self.last_due_s = -math.inf

    def due_s(self) -> float:
        return self.in_transit[0][0] if self.in_transit else math.inf


class Channel:
    """Both directions of one vehicle's impaired link, without I/O and without a clock."""

    def __init__(self) -> None:
        self._lanes = {direction: _Lane() for direction in Direction}
        self._order = itertools.count()  # frames due at the same time leave in order of arrival

    def add(self, direction: Direction, stage: Stage, *, in_order: bool = True) -> Callable[[], None]:
        """Append a stage, and return a function that removes it; `in_order`: it keeps the frames' order."""
        stages, entry = self._lanes[direction].stages, (stage, in_order)
        stages.append(entry)
        return lambda: stages.remove(entry)

    def put(self, direction: Direction, frame: bytes, now: float) -> None:
        """Send one frame at `now` [s]."""
        lane = self._lanes[direction]
        timed_frames: TimedFrames = [(frame, now)]
        for stage, _ in lane.stages:
            timed_frames = [output for timed in timed_frames for output in stage(*timed)]
        # Later frames must not overtake frames that a removed stage has delayed.
        if all(in_order for _, in_order in lane.stages):
            timed_frames = [(frame, max(due_s, lane.last_due_s)) for frame, due_s in timed_frames]
            lane.last_due_s = max((due_s for _, due_s in timed_frames), default=lane.last_due_s)
        for output, due_s in timed_frames:
            self.inject(direction, output, due_s)

    def inject(self, direction: Direction, frame: bytes, due_s: float) -> None:
        """Add a frame that skips the stages, such as RADIO_STATUS, and arrives at `due_s` [s]."""
        heapq.heappush(self._lanes[direction].in_transit, (due_s, next(self._order), frame))

    def take(self, direction: Direction, now: float) -> TimedFrames:
        """Return the frames that arrive by `now` [s] in order of arrival, each with its time."""
        in_transit = self._lanes[direction].in_transit
        arrived = []
        while in_transit and in_transit[0][0] <= now:
            due_s, _, frame = heapq.heappop(in_transit)
            arrived.append((frame, due_s))
        return arrived

    def next_due_s(self, direction: Direction | None = None) -> float:
        """Return the arrival time of the next frame [s], by default in both directions; inf: no frame."""
        lanes = self._lanes.values() if direction is None else (self._lanes[direction],)
        return min(lane.due_s() for lane in lanes)

    @property
    def idle(self) -> bool:
        """True if the channel has no stages and no frames in transit."""
        return not any(lane.stages or lane.in_transit for lane in self._lanes.values())
