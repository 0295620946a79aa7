"""Who hears whom: the communication range of the paper, above every transport."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from swarmctl.bus import keys
from swarmctl.bus.base import Transport
from swarmctl.core.geo import distance_m
from swarmctl.core.messages import BadMessage, Message, ObservationShared, StateShared, decode, encode


def recipients(sender: int, states: Mapping[int, StateShared | None], k: int | None) -> tuple[int, ...]:
    """The `k` nearest alive UAVs to `sender` by last known position, nearest first; None means everybody.

    A UAV whose position is unknown comes last; one that has failed hears nothing.
    """
    others = [u for u, s in states.items() if u != sender and (s is None or s.phase != "failed")]
    if k is None or k >= len(others):
        return tuple(sorted(others))
    here = states.get(sender)

    def far(uav: int) -> tuple[float, int]:
        there = states[uav]
        if here is None or there is None:
            return (math.inf, uav)
        return (distance_m((here.lat_deg, here.lon_deg), (there.lat_deg, there.lon_deg)), uav)

    return tuple(sorted(others, key=far)[:k])


def _own(message: Message) -> bool:
    """Nobody speaks for another: what it tells it has seen itself."""
    return not isinstance(message, ObservationShared) or message.observation.observer == message.sender


class Network:
    """The swarm's agents on one transport."""

    def __init__(self, transport: Transport, swarm: str, k: int | None) -> None:
        self._transport = transport
        self._swarm = swarm
        self._k = k
        self._states: dict[int, StateShared | None] = {}
        self.refused = 0

    def join(self, uav: int, on_message: Callable[[ObservationShared], None]) -> None:
        """Deliver to `on_message` what others observe and send to `uav`; what is no message is refused.

        Where others are is for the reach model alone.
        """

        def receive(key: str, payload: bytes) -> None:
            try:
                message = decode(payload)
            except BadMessage:
                self.refused += 1
                return
            if message.sender != keys.sender_of(key) or message.sender == uav or not _own(message):
                self.refused += 1
                return
            if isinstance(message, StateShared):
                self._states[message.sender] = message
            else:
                on_message(message)

        self._states[uav] = None
        self._transport.subscribe(keys.inbox(self._swarm, uav), receive)

    def publish(self, message: Message) -> int:
        """Send to everyone in the sender's reach; returns how many that were."""
        if isinstance(message, StateShared):
            self._states[message.sender] = message
        to = recipients(message.sender, self._states, self._k)
        payload = encode(message)
        for uav in to:
            self._transport.put(keys.inform(self._swarm, uav, message), payload)
        return len(to)
