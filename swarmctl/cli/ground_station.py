"""A ground station of a swarm on many machines: its way onto the network, and the state of its connection."""

from __future__ import annotations

import datetime as dt
from pathlib import Path

import msgspec

from swarmctl.bus.transports.access import OPERATOR
from swarmctl.bus.transports.zenoh import ZenohBus
from swarmctl.bus.transports.zenoh_config import Configuration
from swarmctl.cli.configuration import fail_for_keys
from swarmctl.cli.console import USAGE, fail
from swarmctl.config import joining
from swarmctl.config.roster import Roster
from swarmctl.core.frames import FrameCodec
from swarmctl.core.operator_text import extended
from swarmctl.security.files import KeyringError


class GroundStation(msgspec.Struct, frozen=True):
    network: Configuration
    codec: FrameCodec
    """verifies the vehicles' signatures, if the swarm has keys"""

    def state_of(self, bus: ZenohBus) -> str:
        """Return the state of the connection in words."""
        where = ", ".join(map(str, self.network.connect))
        if bus.connected:
            return f"{where}: connected"
        trouble = f" ({bus.trouble})" if bus.trouble else ""
        return f"{where}: not connected{trouble}: {joining.connection_advice(self.network)}"


def ground_station_or_exit(config: Path, swarm: Roster, connect: str | None) -> GroundStation:
    """Return the station with the operator's keys; exit if keys or a network are missing."""
    try:
        keyring = joining.keyring_of(swarm, OPERATOR, dt.datetime.now(dt.UTC))
        network = joining.as_station(swarm, connect, keyring)
    except KeyringError as error:
        fail_for_keys(config, error)
    except joining.NoNetwork as error:
        advice = "" if connect is not None else ", or give --connect tcp/HOST:PORT"
        fail([extended(str(error), advice)], USAGE)
    return GroundStation(network, FrameCodec(swarm.name, None, None if keyring is None else keyring.verify))
