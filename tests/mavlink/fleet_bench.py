"""A session and one vehicle of the simulator on a virtual clock, with a wire that loses and doubles."""

from __future__ import annotations

import random
from typing import Any

from sim_vehicle.fleet import Fleet
from sim_vehicle.scenario import Scenario
from swarmctl.mavlink.codec import Decoder, Encoder, FrameSplitter
from swarmctl.mavlink.conversation import Peer
from swarmctl.mavlink.parameters import BYTE_WISE
from swarmctl.mavlink.session import Session, Step

STEP_S = 0.1
PLACE = (46.0490, 14.5060)


class FleetBench:
    """`sent` has the messages of the session; `params` the vehicle's own."""

    def __init__(
        self,
        personality: str = "ardupilot",
        *,
        loss: float = 0.0,
        seed: int = 0,
        params: dict[str, float] | None = None,
        faults: tuple[str, ...] = (),
    ) -> None:
        vehicle = {
            "sysid": 1,
            "lat_deg": PLACE[0],
            "lon_deg": PLACE[1],
            "alt_amsl_m": 300.0,
            "personality": personality,
            "params": params or {},
        }
        scenario = Scenario.model_validate({"seed": 1, "vehicles": [vehicle], "faults": list(faults)})
        self.fleet = Fleet(scenario, ready_s=0.0)
        self.vehicle = self.fleet.vehicles[0]
        self.session = Session(Peer(1))
        self.sent: list[Any] = []
        self.now = 0.0
        self.loss = 0.0
        self._rng = random.Random(seed)
        self._encoder, self._decoder, self._splitter = Encoder(), Decoder(), FrameSplitter()
        assert self.run(10.0, lambda: self.session.state.mode != ""), "it is never heard"
        self._take(self.session.keep_streams(self.now))
        self.run(1.0)
        self.loss = loss

    @property
    def params(self) -> Any:
        return self.vehicle.params

    @property
    def byte_wise(self) -> bool:
        return self.session.autopilot in BYTE_WISE

    def names(self, kind: str) -> list[Any]:
        """What was sent of a message."""
        return [m for m in self.sent if m.get_type() == kind]

    def do(self, name: str, procedure: Any, limit_s: float = 200.0) -> Any:
        """Run a procedure to its end."""
        self._take(self.session.begin(name, procedure, self.now))
        assert self.run(limit_s, lambda: self.session.busy_with is None), f"{name} does not end"
        return self.session.result

    def run(self, seconds: float, until: Any = lambda: False) -> bool:
        """Let time pass; True as soon as `until()` holds."""
        end = self.now + seconds
        while self.now < end:
            if until():
                return True
            self.now += STEP_S
            self._down(self.fleet.step(self.now))
            self._take(self.session.tick(self.now))
        return bool(until())

    def _take(self, step: Step) -> None:
        for message in step.messages:
            self.sent.append(message)
            data = self._encoder.pack(message, 0)
            if self._rng.random() >= self.loss:
                self._down(self.fleet.receive(data, self.now, peer="gcs"))

    def _down(self, frames: list[tuple[int, bytes]]) -> None:
        for _, data in frames:
            if self._rng.random() < self.loss:
                continue
            for frame in self._splitter.feed(data):
                message = self._decoder.decode(frame)
                if message is not None:
                    self._take(self.session.receive(message, self.now))
