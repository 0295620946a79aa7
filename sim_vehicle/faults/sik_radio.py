"""A bad pair of SiK radios: one slow radio channel for both directions, bursts of loss, RADIO_STATUS.

A radio answers each heartbeat with RADIO_STATUS to the sender, from system '3', component 'D'. The two radios
transmit in turns. A frame waits for earlier frames and for a turn; then its transmission takes time.
"""

from collections import deque
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.faults.base import EndFault, Fault, FaultTarget, Share
from sim_vehicle.faults.link import BurstLoss, Corruption
from sim_vehicle.wire.channel import Channel, Direction, TimedFrames

RADIO_SYSTEM, RADIO_COMPONENT = ord("3"), ord("D")
PACKET_OVERHEAD_BYTES = 16  # preamble, synchronisation, header, trailer and checksum in the air
SIGNAL_SPREAD = 4.0  # standard deviation of the reported signal strength and noise, raw


class _Air:
    """The radio channel that both radios share."""

    def __init__(self) -> None:
        self.free_from_s = 0.0  # end of the latest transmission
        self.transmitter: Radio | None = None


class Radio:
    """The radio that transmits the frames of one direction."""

    def __init__(
        self, params: "SikRadio", air: _Air, channel: Channel, direction: Direction, rng: np.random.Generator
    ):
        self._params, self._air, self._channel = params, air, channel
        self._direction, self._rng = direction, rng
        self._loss = params.bursts().stage(rng)
        self._corruption = Corruption(rate=params.spoilt).stage(rng)
        self._waiting: deque[tuple[float, int]] = deque()  # end of the transmission [s], length [bytes]
        self._waiting_bytes = 0
        self._codec = mavlink.MAVLink(None, srcSystem=RADIO_SYSTEM, srcComponent=RADIO_COMPONENT)
        self.other: Radio | None = None
        self.lost = 0  # frames lost in the air

    def __call__(self, frame: bytes, due_s: float) -> TimedFrames:
        self._remove_transmitted(due_s)
        if is_heartbeat(frame):
            self._report(due_s)
        if self._waiting_bytes + len(frame) > self._params.buffer_bytes:
            return []
        sent_s = self._transmit(len(frame), due_s)
        self._waiting.append((sent_s, len(frame)))
        self._waiting_bytes += len(frame)
        arrived = self._loss(frame, sent_s)
        if not arrived:
            self.lost += 1
            return []
        return self._corruption(*arrived[0])

    def _remove_transmitted(self, now: float) -> None:
        while self._waiting and self._waiting[0][0] <= now:
            self._waiting_bytes -= self._waiting.popleft()[1]

    def _transmit(self, length: int, due_s: float) -> float:
        """Transmit one frame; return the end of the transmission [s]."""
        air = self._air
        start_s = max(due_s, air.free_from_s)
        if air.transmitter is not self or start_s > air.free_from_s:  # a new turn
            start_s += self._params.turn_s * self._rng.random()
        air.transmitter = self
        air.free_from_s = start_s + 8.0 * (length + PACKET_OVERHEAD_BYTES) / self._params.air_rate_bit_s
        return air.free_from_s

    def _report(self, now: float) -> None:
        params = self._params
        free_share = 1.0 - self._waiting_bytes / params.buffer_bytes
        lost_by_other = 0 if self.other is None else self.other.lost
        report = mavlink.MAVLink_radio_status_message(
            self._raw(params.rssi),
            self._raw(params.rssi),
            round(100 * max(free_share, 0.0)),
            self._raw(params.noise),
            self._raw(params.noise),
            lost_by_other & 0xFFFF,
            0,
        )
        back = next(direction for direction in Direction if direction is not self._direction)
        self._channel.inject(back, bytes(report.pack(self._codec)), now)
        self._codec.seq = (self._codec.seq + 1) % 256

    def _raw(self, mean: int) -> int:
        return int(np.clip(round(self._rng.normal(mean, SIGNAL_SPREAD)), 0, 254))


def is_heartbeat(frame: bytes) -> bool:
    if frame[:1] == b"\xfd":
        return frame[7:10] == b"\0\0\0"
    return frame[:1] == b"\xfe" and frame[5:6] == b"\0"


class SikRadio(Fault):
    name = "sik_radio"
    summary = "a bad SiK radio: slow, shared by both directions, bursts of loss, RADIO_STATUS"

    air_rate_bit_s: Annotated[float, Field(ge=2000, le=250_000)] = Field(
        default=57_600.0, description="bits a second in the air, both directions together"
    )
    rate: Share = Field(default=0.12, description="share of the frames lost")
    burst_frames: Annotated[float, Field(ge=1)] = Field(
        default=4.0, description="mean length of a burst of losses, in frames"
    )
    spoilt: Share = Field(default=0.005, description="share of the frames with flipped bits")
    turn_s: Annotated[float, Field(ge=0, le=1)] = Field(
        default=0.06, description="longest wait for a turn to transmit"
    )
    buffer_bytes: Annotated[int, Field(ge=300)] = Field(
        default=2048, description="buffer of a radio; a frame that does not fit is lost"
    )
    rssi: Annotated[int, Field(ge=0, le=254)] = Field(default=75, description="reported signal strength, raw")
    noise: Annotated[int, Field(ge=0, le=254)] = Field(default=50, description="reported noise, raw")

    @model_validator(mode="after")
    def _check_bursts(self) -> Self:
        self.bursts()
        return self

    def bursts(self) -> BurstLoss:
        return BurstLoss(rate=self.rate, burst_frames=self.burst_frames)

    def begin(self, target: FaultTarget, now: float) -> EndFault:
        channel, air = target.vehicle.channel(), _Air()
        ground = Radio(self, air, channel, Direction.TO_VEHICLE, target.generator())
        vehicle = Radio(self, air, channel, Direction.FROM_VEHICLE, target.generator())
        ground.other, vehicle.other = vehicle, ground
        remove_ground = channel.add(Direction.TO_VEHICLE, ground)
        remove_vehicle = channel.add(Direction.FROM_VEHICLE, vehicle)

        def end(_end_s: float) -> None:
            remove_ground()
            remove_vehicle()

        return end
