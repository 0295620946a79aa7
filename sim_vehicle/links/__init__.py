"""The links of a fleet, one transport a file; they carry bytes and know no MAVLink."""

from collections.abc import Collection

from sim_vehicle.links.base import Batch, Ends, Link, LinkError
from sim_vehicle.links.tcp import TcpIn, TcpOut
from sim_vehicle.links.udp import UdpIn, UdpOut
from sim_vehicle.links.url import Url

__all__ = ["Batch", "Ends", "Link", "LinkError", "make_link"]


def make_link(url: Url, ends: Ends, *, vehicles: Collection[int]) -> Link:
    """Return the link of a URL, not open yet, for these vehicles."""
    if url.serial:
        from sim_vehicle.links.serial import SerialLink  # noqa: PLC0415 - pyserial is rarely needed

        return SerialLink(url, ends)
    if url.udp:
        return UdpIn(url, ends) if url.listens else UdpOut(url, ends, vehicles)
    alone = len(vehicles) == 1
    return TcpIn(url, ends, alone=alone) if url.listens else TcpOut(url, ends, alone=alone)
