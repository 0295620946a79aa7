"""The network of a scenario: the radio model, the options of its nodes, the members of the swarm."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Literal

from swarmctl.bus.network import Network, RunClock
from swarmctl.bus.node.exchange import NodeOptions
from swarmctl.bus.radio import Partition, Radio, RadioSettings, RadioSilence
from swarmctl.bus.transports.base import Transport
from swarmctl.config.communication import Communication
from swarmctl.config.scenario import Scenario
from swarmctl.core.frames import FrameCodec
from swarmctl.core.operator_text import resolve_vehicles


def options_of(scenario: Scenario) -> NodeOptions:
    c = scenario.config.communication
    return NodeOptions(
        rows=scenario.grid.rows,
        cols=scenario.grid.cols,
        k=None if c.range == "all" else c.range,
        relay=c.relay,
        sync_every_s=c.sync_every_s,
        round_trip_s=2.0 * (c.delay_s + c.jitter_s),
        clock_tolerance_s=c.clock_tolerance_s,
        perfect_sensors=scenario.prior.sensor.is_perfect,
    )


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


def speedup_of(scenario: Scenario, clock: Literal["real", "virtual"]) -> float:
    """Return the simulated seconds in one second of the loop."""
    simulate = scenario.config.simulate
    return simulate.speedup if simulate is not None and clock == "real" else 1.0


def network_of(
    scenario: Scenario,
    transport: Transport,
    clock: RunClock,
    frame_codec: FrameCodec | None = None,
    say: Callable[[int, str], None] = lambda _uav, _text: None,
) -> Network:
    """Return the network of a swarm; this process flies some or all of the vehicles."""
    names = scenario.config.names
    return Network(
        transport,
        scenario.config.name,
        names,
        options_of(scenario),
        clock=clock,
        radio=Radio(radio_settings(scenario.config.communication, names), scenario.config.seed),
        codec=frame_codec,
        seed=scenario.config.seed,
        say=say,
    )
