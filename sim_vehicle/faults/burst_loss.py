"""Frames are lost in bursts, by the two-state Gilbert-Elliott chain."""

from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from sim_vehicle.faults.base import (
    DIRECTION,
    EndFault,
    Fault,
    FaultParams,
    FaultTarget,
    LinkDirections,
    Share,
)
from sim_vehicle.wire.channel import TimedFrames


class Params(FaultParams):
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
        share = self.bad_share
        if share >= 1 or share / (1 - share) > self.burst_frames:
            raise ValueError(
                f"rate {self.rate:g} is too high for bad spells of {self.burst_frames:g} frames; "
                f"lower rate or raise burst_frames"
            )
        return self

    @property
    def bad_share(self) -> float:
        """Return the share of the frames in bad spells."""
        return (self.rate - self.good_loss) / (self.bad_loss - self.good_loss)

    @property
    def end_probability(self) -> float:
        """Return the probability that a bad spell ends after a frame."""
        return 1.0 / self.burst_frames

    @property
    def begin_probability(self) -> float:
        """Return the probability that a bad spell begins after a frame, so that `bad_share` is stationary."""
        return self.end_probability * self.bad_share / (1.0 - self.bad_share)


class BurstLoss:
    """A stage that drops frames by a Gilbert-Elliott chain, started in its stationary distribution."""

    in_order = True

    def __init__(self, params: Params, rng: np.random.Generator) -> None:
        self._rng = rng
        self._loss_share = (params.good_loss, params.bad_loss)
        self._switch_probability = (params.begin_probability, params.end_probability)
        self._in_bad_spell = bool(rng.random() < params.bad_share)

    def __call__(self, frame: bytes, due_s: float) -> TimedFrames:
        lost = self._rng.random() < self._loss_share[self._in_bad_spell]
        if self._rng.random() < self._switch_probability[self._in_bad_spell]:
            self._in_bad_spell = not self._in_bad_spell
        return [] if lost else [(frame, due_s)]


def begin(target: FaultTarget, params: Params, _now: float) -> EndFault:
    return target.disturb(params.direction, lambda rng: BurstLoss(params, rng))


FAULT = Fault("burst_loss", "frames are lost in bursts (Gilbert-Elliott)", Params, begin)
