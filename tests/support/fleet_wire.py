"""A wire directly into a `Fleet`: waiting advances simulated time, without a socket."""

from collections import deque

from sim_vehicle.fleet import Fleet

STEP_S = 0.05


class FleetWire:
    """The `Wire` of one ground station of a fleet under simulated time."""

    def __init__(self, fleet: Fleet) -> None:
        self.fleet = fleet
        self._now = 0.0
        self._queue = deque(frame for _, frame in fleet.step(0.0))

    def send(self, data: bytes) -> None:
        self._queue.extend(frame for _, frame in self.fleet.receive(data, self._now, peer="conformance"))

    def receive(self, timeout_s: float) -> bytes | None:
        end_s = self._now + timeout_s
        while not self._queue and self._now < end_s:
            self._now = min(self._now + STEP_S, end_s)
            self._queue.extend(frame for _, frame in self.fleet.step(self._now))
        return self._queue.popleft() if self._queue else None

    def now_s(self) -> float:
        return self._now

    def follow(self, sysid: int) -> None:
        """Do nothing: every vehicle receives every message and processes those addressed to it."""

    def close(self) -> None: ...
