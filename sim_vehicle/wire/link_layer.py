"""The link layer between the fleet and its ground stations: signatures and impaired links."""

from collections.abc import Collection, Iterable, Iterator
from typing import Any

from sim_vehicle.wire.channel import Channel, Direction
from sim_vehicle.wire.outbox import Frames
from sim_vehicle.wire.parser import Parser
from sim_vehicle.wire.signing import Signing

Arrival = tuple[float, int, Any]  # time [s], vehicle's index, message


class LinkLayer:
    """Last step of outgoing frames and first step of incoming messages.

    Parameters
    ----------
    signings: the signing state of each vehicle.
    links: the link number of each vehicle.
    trusted_links: numbers of the links that require no signatures, as an autopilot's USB does.
    """

    def __init__(
        self, signings: Iterable[Signing], links: tuple[int, ...], trusted_links: Collection[int]
    ) -> None:
        self._signings, self._links, self._trusted_links = tuple(signings), links, trusted_links
        self._signing: dict[int, Signing] = {}  # vehicle's index -> its active signing
        self._channels: dict[int, Channel] = {}  # vehicle's index -> its impaired link
        self._parsers: dict[int, Parser] = {}

    @property
    def frames_pass_unchanged(self) -> bool:
        """True if no vehicle signs and no link is impaired."""
        return not (self._signing or self._channels)

    def channel(self, index: int) -> Channel:
        """Return the channel of a vehicle; create a missing channel."""
        if index not in self._channels:
            self._channels[index] = Channel()
            self._parsers[index] = Parser()
        return self._channels[index]

    def update_signing(self, index: int) -> None:
        """Activate or deactivate signing after a possible change of a vehicle's key."""
        self._signing.pop(index, None)
        if self._signings[index].active:
            self._signing[index] = self._signings[index]

    def accepts(self, index: int, message: Any) -> bool:
        """Return True if a vehicle may obey a message: its signature is valid or not required."""
        signing = self._signing.get(index)
        if signing is None or self._links[index] in self._trusted_links:
            return True
        return signing.accepts(bytes(message.get_msgbuf()))

    def send(self, frames: Frames, now: float) -> Frames:
        """Sign frames; put the frames of impaired links into channels and return the remaining frames."""
        direct = []
        for index, frame in frames:
            signing = self._signing.get(index)
            signed = frame if signing is None else signing.sign(frame, self._links[index])
            channel = self._channels.get(index)
            if channel is None:
                direct.append((index, signed))
            else:
                channel.put(Direction.FROM_VEHICLE, signed, now)
        return direct

    def put_incoming(self, index: int, message: Any, now: float) -> bool:
        """Put a message into the channel to a vehicle; return False if the link is unimpaired."""
        channel = self._channels.get(index)
        if channel is not None:
            channel.put(Direction.TO_VEHICLE, bytes(message.get_msgbuf()), now)
        return channel is not None

    def arrivals_at_vehicles(self, now: float) -> Iterator[Arrival]:
        """Yield the messages that reach vehicles by `now` [s], in order for each vehicle."""
        for index, channel in tuple(self._channels.items()):
            while channel.next_due_s(Direction.TO_VEHICLE) <= now:
                due_s = channel.next_due_s(Direction.TO_VEHICLE)
                for frame, _ in channel.take(Direction.TO_VEHICLE, due_s):
                    for message in self._parsers[index].feed(frame):
                        yield due_s, index, message

    def arrivals_at_stations(self, now: float) -> Frames:
        """Return the frames from vehicles that arrive by `now` [s], in order; remove idle channels."""
        arrived = []
        for index, channel in tuple(self._channels.items()):
            arrived += [(due_s, index, frame) for frame, due_s in channel.take(Direction.FROM_VEHICLE, now)]
            if channel.idle:
                del self._channels[index], self._parsers[index]
        arrived.sort(key=lambda arrival: arrival[0])
        return [(index, frame) for _, index, frame in arrived]
