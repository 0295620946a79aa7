"""The network of a scenario: the radio model, the options of its nodes, the members of the swarm."""

from __future__ import annotations

from collections.abc import Callable

from swarmctl.bus.network import Network, RunClock
from swarmctl.bus.node.exchange import NodeOptions
from swarmctl.bus.radio import Radio
from swarmctl.bus.transports.base import Transport
from swarmctl.config.radio import radio_settings
from swarmctl.config.scenario import Scenario
from swarmctl.core.frames import FrameCodec


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
