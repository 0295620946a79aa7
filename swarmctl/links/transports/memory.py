"""Wire inside the process, for runs on a virtual clock: ground station and vehicles share one loop."""

from __future__ import annotations

import asyncio

from swarmctl.links.transports.base import Address, Receive


class MemoryWire:
    """Wire `memory:NAME` between the ground's transport and simulated vehicles.

    Both directions deliver in order, in a later turn of the loop: the sender's call returns first.
    """

    def __init__(self) -> None:
        self._to_vehicles: Receive | None = None
        self._to_ground: Receive | None = None
        self._on_the_way: list[tuple[bytes, Address]] = []
        """frames to the ground; one turn of the loop delivers all of them"""

    def from_vehicle(self, data: bytes, address: Address) -> None:
        """Send bytes from the vehicles' side to the ground; replies go to `address`, an arbitrary name."""
        if not self._on_the_way:
            asyncio.get_running_loop().call_soon(self._deliver_to_ground)
        self._on_the_way.append((data, address))

    def _deliver_to_ground(self) -> None:
        arrived, self._on_the_way = self._on_the_way, []
        for data, address in arrived:
            if self._to_ground is not None:
                self._to_ground(data, address)

    def from_ground(self, data: bytes, address: Address) -> None:
        asyncio.get_running_loop().call_soon(self._deliver_to_vehicles, data, address)

    def _deliver_to_vehicles(self, data: bytes, address: Address) -> None:
        if self._to_vehicles is not None:
            self._to_vehicles(data, address)

    def connect_ground(self, receive: Receive | None) -> None:
        """Let `receive` get bytes of vehicles, with the vehicle's address; None: drop them."""
        self._to_ground = receive

    def connect_vehicles(self, receive: Receive | None) -> None:
        """Let `receive` get bytes from the ground, with their target address; None: drop them."""
        self._to_vehicles = receive


class MemoryTransport:
    """Transport on the ground's end of a wire."""

    trouble = ""
    has_unread = False

    def __init__(self, wire: MemoryWire) -> None:
        self._wire = wire

    async def open(self, receive: Receive) -> None:
        self._wire.connect_ground(receive)

    def send(self, data: bytes, address: Address) -> None:
        self._wire.from_ground(data, address)

    def peers(self) -> tuple[Address, ...]:
        return ()

    async def close(self) -> None:
        self._wire.connect_ground(None)
