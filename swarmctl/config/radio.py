"""The settings of the radio model, from the section `communication`. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping

from swarmctl.bus.radio import Partition, RadioSettings, RadioSilence
from swarmctl.config.communication import Communication
from swarmctl.core.operator_text import resolve_vehicles


def radio_settings(communication: Communication, names: Mapping[int, str]) -> RadioSettings:
    """Return the settings of the radio; `names`: names of the vehicles by system id.

    Raises ValueError if a configured name does not match exactly one vehicle, or for contradictory losses.
    """
    c = communication
    return RadioSettings(
        delay_s=c.delay_s,
        jitter_s=c.jitter_s,
        loss=c.loss,
        loss_burst=c.loss_burst,
        bandwidth_bytes_s=_or_infinite(c.bandwidth_bytes_s),
        max_distance_m=_or_infinite(c.max_distance_m),
        min_distance_m=c.min_distance_m,
        partitions=tuple(
            Partition(
                tuple(frozenset(resolve_vehicles(group, names)) for group in p.groups),
                p.from_s,
                _or_infinite(p.until_s),
            )
            for p in c.partitions
        ),
        quiet=tuple(
            RadioSilence(frozenset(resolve_vehicles(q.uavs, names)), q.from_s, _or_infinite(q.until_s))
            for q in c.quiet
        ),
    )


def _or_infinite(value: float | None) -> float:
    return math.inf if value is None else value
