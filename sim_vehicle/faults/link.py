"""Faults of the link between a vehicle and its ground stations."""

import math
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from sim_vehicle.faults.base import DIRECTION, LinkDirections, LinkFault, Share
from sim_vehicle.wire.channel import Stage, TimedFrames

Seconds = Annotated[float, Field(ge=0, le=60)]


class PacketLoss(LinkFault):
    name, summary = "packet_loss", "frames are lost at random"

    rate: Share = Field(default=0.1, description="share of the frames lost")
    direction: LinkDirections = DIRECTION

    def stage(self, rng: np.random.Generator) -> Stage:
        return lambda frame, due_s: [] if rng.random() < self.rate else [(frame, due_s)]


class BurstLoss(LinkFault):
    """The two-state Gilbert-Elliott chain, started in its stationary distribution."""

    name, summary = "burst_loss", "frames are lost in bursts (Gilbert-Elliott)"

    rate: Share = Field(default=0.1, description="share of the frames lost in the long run")
    burst_frames: Annotated[float, Field(ge=1)] = Field(
        default=5.0, description="mean length of a bad spell, in frames"
    )
    bad_loss: Share = Field(default=1.0, description="share lost in a bad spell")
    good_loss: Share = Field(default=0.0, description="share lost between bad spells")
    direction: LinkDirections = DIRECTION

    @model_validator(mode="after")
    def _check_chain(self) -> Self:
        if not self.good_loss <= self.rate <= self.bad_loss or self.good_loss == self.bad_loss:
            raise ValueError(
                f"rate {self.rate:g} must lie between good_loss {self.good_loss:g} and bad_loss "
                f"{self.bad_loss:g}, which must differ"
            )
        share = self._bad_share
        if share >= 1 or share / (1 - share) > self.burst_frames:
            raise ValueError(
                f"rate {self.rate:g} is too high for bad spells of {self.burst_frames:g} frames; "
                f"lower rate or raise burst_frames"
            )
        return self

    @property
    def _bad_share(self) -> float:
        """Return the share of the frames in bad spells."""
        return (self.rate - self.good_loss) / (self.bad_loss - self.good_loss)

    def stage(self, rng: np.random.Generator) -> Stage:
        # Probabilities that a bad spell begins or ends after a frame, so that the bad share is stationary.
        ends = 1.0 / self.burst_frames
        begins = ends * self._bad_share / (1.0 - self._bad_share)
        in_bad_spell = bool(rng.random() < self._bad_share)

        def lose(frame: bytes, due_s: float) -> TimedFrames:
            nonlocal in_bad_spell
            lost = rng.random() < (self.bad_loss if in_bad_spell else self.good_loss)
            if rng.random() < (ends if in_bad_spell else begins):
                in_bad_spell = not in_bad_spell
            return [] if lost else [(frame, due_s)]

        return lose


class Delay(LinkFault):
    name, summary = "delay", "frames arrive late, with jitter"

    delay_s: Seconds = Field(default=0.5, description="mean delay in each direction")
    jitter_s: Seconds = Field(default=0.0, description="largest deviation from the mean delay")
    direction: LinkDirections = DIRECTION

    @model_validator(mode="after")
    def _check_jitter(self) -> Self:
        if self.jitter_s > self.delay_s:
            raise ValueError(f"jitter_s {self.jitter_s:g} must not exceed delay_s {self.delay_s:g}")
        return self

    def stage(self, rng: np.random.Generator) -> Stage:
        last_due_s = -math.inf

        def delay(frame: bytes, due_s: float) -> TimedFrames:
            nonlocal last_due_s
            added_s = self.delay_s + self.jitter_s * rng.uniform(-1.0, 1.0)
            last_due_s = max(due_s + added_s, last_due_s)
            return [(frame, last_due_s)]

        return delay


class Duplication(LinkFault):
    name, summary = "duplication", "frames arrive twice"

    rate: Share = Field(default=0.1, description="share of the frames duplicated")
    gap_s: Seconds = Field(
        default=0.0, description="time from a frame to its copy; other frames can arrive in between"
    )
    direction: LinkDirections = DIRECTION

    @property
    def in_order(self) -> bool:
        return self.gap_s == 0

    def stage(self, rng: np.random.Generator) -> Stage:
        def duplicate(frame: bytes, due_s: float) -> TimedFrames:
            copies = [(frame, due_s + self.gap_s)] if rng.random() < self.rate else []
            return [(frame, due_s), *copies]

        return duplicate


class Reordering(LinkFault):
    """A delay of up to hold_s (uniform) of a share of the frames; later frames can overtake."""

    name, summary = "reordering", "frames overtake each other"

    rate: Share = Field(default=0.1, description="share of the frames delayed")
    hold_s: Annotated[float, Field(gt=0, le=60)] = Field(default=0.2, description="longest delay of a frame")
    direction: LinkDirections = DIRECTION

    @property
    def in_order(self) -> bool:
        return False

    def stage(self, rng: np.random.Generator) -> Stage:
        def hold(frame: bytes, due_s: float) -> TimedFrames:
            delayed = rng.random() < self.rate
            return [(frame, due_s + (self.hold_s * rng.random() if delayed else 0.0))]

        return hold


class Corruption(LinkFault):
    """Flipped bits; the receiver rejects nearly all corrupted frames by the checksum.

    In the covered fields the checksum detects all errors of up to three bits and nearly all larger errors.
    """

    name, summary = "corruption", "bits flip in transit"

    rate: Share = Field(default=0.1, description="share of the frames corrupted")
    bits: Annotated[int, Field(ge=1, le=64)] = Field(
        default=3, description="largest number of flipped bits in a frame"
    )
    direction: LinkDirections = DIRECTION

    def stage(self, rng: np.random.Generator) -> Stage:
        def corrupt(frame: bytes, due_s: float) -> TimedFrames:
            if not frame or rng.random() >= self.rate:
                return [(frame, due_s)]
            flips = min(int(rng.integers(1, self.bits + 1)), 8 * len(frame))
            corrupted = bytearray(frame)
            for bit in rng.choice(8 * len(frame), size=flips, replace=False).tolist():
                corrupted[bit // 8] ^= 1 << bit % 8
            return [(bytes(corrupted), due_s)]

        return corrupt


class Bandwidth(LinkFault):
    name, summary = "bandwidth", "a limited byte rate, with a finite buffer"

    rate_bytes_s: Annotated[float, Field(ge=10)] = Field(default=5000.0, description="rate of each direction")
    buffer_bytes: Annotated[int, Field(ge=300)] = Field(
        default=2048, description="buffer size; a frame that does not fit into the buffer is lost"
    )
    direction: LinkDirections = DIRECTION

    def stage(self, rng: np.random.Generator) -> Stage:
        free_from_s = 0.0  # end of the latest transmission

        def limit(frame: bytes, due_s: float) -> TimedFrames:
            nonlocal free_from_s
            start_s = max(free_from_s, due_s)
            waiting_bytes = (start_s - due_s) * self.rate_bytes_s
            if waiting_bytes + len(frame) > self.buffer_bytes:
                return []
            free_from_s = start_s + len(frame) / self.rate_bytes_s
            return [(frame, free_from_s)]

        return limit


class LinkOutage(LinkFault):
    name, summary = "link_outage", "no frame passes in either direction"

    def stage(self, rng: np.random.Generator) -> Stage:
        return lambda _frame, _due_s: []


class OneWay(LinkOutage):
    name, summary = "one_way", "the link is dead in one direction"

    dead: Literal["to_vehicle", "from_vehicle"] = Field(
        default="to_vehicle", description="direction in which no frame passes"
    )

    @property
    def affected(self) -> LinkDirections:
        return self.dead
