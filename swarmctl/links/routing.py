"""At which address a vehicle is. Pure."""

from __future__ import annotations

from enum import Enum
from math import inf

from swarmctl.links.transports.base import Address

SILENT_S = 2.0
"""after this long without a word from its address, a vehicle may speak from another one"""


class AddressVerdict(Enum):
    ACCEPTED = "accepted"
    MOVED = "moved"
    """accepted, and the vehicle is at this address from now on"""
    DROPPED = "dropped"
    """from another address than the vehicle's"""
    CONFLICT = "conflict"
    """accepted, and it is certain now that `rival` uses the same system id"""


class AddressTracker:
    """The address of one system id on one endpoint.

    Over UDP a rebooted vehicle comes back from another port, and two vehicles may have been given the same
    system id. Both look like a second address; only in the second case does the first one go on speaking.
    """

    def __init__(self) -> None:
        self.address: Address | None = None
        self.rival: Address | None = None
        self._heard = -inf
        self._rival_heard = -inf
        self._reported: set[Address] = set()

    def hear(self, address: Address, now: float) -> AddressVerdict:
        """A frame of this system id came from `address`."""
        if address == self.address:
            self._heard = now
            if self._rival_heard > now - SILENT_S and self.rival not in self._reported:
                self._reported.add(self.rival)
                return AddressVerdict.CONFLICT
            return AddressVerdict.ACCEPTED
        if self.address is None or now - self._heard >= SILENT_S:
            first = self.address is None
            self.address, self.rival = address, None
            self._heard, self._rival_heard = now, -inf
            self._reported.clear()
            return AddressVerdict.ACCEPTED if first else AddressVerdict.MOVED
        self.rival, self._rival_heard = address, now
        return AddressVerdict.DROPPED
