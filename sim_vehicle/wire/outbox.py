"""Outgoing frames of the fleet with their vehicles, in order."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.physics.world import World
from sim_vehicle.wire.encode import frames
from sim_vehicle.wire.status import Status
from sim_vehicle.wire.streams import Streams
from sim_vehicle.wire.telemetry import STREAMS, View

Frames = list[tuple[int, bytes]]
"""(vehicle's index, one MAVLink frame or boot text)"""


class Outbox:
    """Encoder and queue of the vehicles' messages and streams, with one sequence counter per vehicle.

    systems: system id of each vehicle.
    component: component id of all vehicles.
    """

    def __init__(self, systems: Sequence[int], component: int, world: World, status: Status) -> None:
        self._systems, self._component = np.array(systems), component
        self._world, self._status = world, status
        self._sequences = np.zeros(len(systems), dtype=np.uint8)
        self._codec = mavlink.MAVLink(None, srcComponent=component)
        self._frames: Frames = []

    def take(self) -> Frames:
        """Return and forget the queued frames."""
        frames, self._frames = self._frames, []
        return frames

    def message(self, vehicle: int, message: Any) -> None:
        """Queue one message of one vehicle."""
        self._codec.srcSystem = int(self._systems[vehicle])
        self._codec.seq = int(self._sequences[vehicle])
        self._sequences[vehicle] = (self._codec.seq + 1) % 256
        self._frames.append((vehicle, bytes(message.pack(self._codec))))

    def raw(self, vehicle: int, data: bytes) -> None:
        """Queue bytes that are not a MAVLink frame, such as a boot text."""
        self._frames.append((vehicle, data))

    def stream_now(self, vehicle: int, message_id: int, now: float) -> bool:
        """Queue one message of STREAMS; return False if the vehicle has no data for the message."""
        return self._send(message_id, np.array([vehicle]), now) == 1

    def stream(self, streams: Streams, now: float) -> None:
        """Queue all due messages of all booted vehicles."""
        for message_id, vehicles in streams.due(now):
            self._send(message_id, vehicles[self._status.booted[vehicles]], now)

    def _send(self, message_id: int, vehicles: npt.NDArray[np.int64], now: float) -> int:
        stream = STREAMS[message_id]
        view = View(self._world, self._status, vehicles, now)
        if stream.has_data is not None:
            view.i = vehicles = vehicles[stream.has_data(view)]
        if len(vehicles):
            systems, sequences = self._systems[vehicles].tolist(), self._sequences[vehicles].tolist()
            self._sequences[vehicles] += 1
            encoded = frames(stream.layout, stream.payloads(view), systems, sequences, self._component)
            self._frames.extend(zip(vehicles.tolist(), encoded, strict=True))
        return len(vehicles)
