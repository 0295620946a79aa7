"""The links of a fleet. Each transport has a module; links do not decode MAVLink."""

from collections.abc import Collection

from sim_vehicle.links.base import Batch, Link, LinkCallbacks, LinkError
from sim_vehicle.links.tcp import TcpIn, TcpOut
from sim_vehicle.links.udp import UdpIn, UdpOut
from sim_vehicle.links.url import Url

__all__ = ["Batch", "Link", "LinkCallbacks", "LinkError", "make_link"]


def make_link(url: Url, callbacks: LinkCallbacks, *, vehicles: Collection[int]) -> Link:
    """Return the unopened link of a URL that carries the vehicles with these indices."""
    if url.is_serial:
        from sim_vehicle.links.serial import SerialLink  # noqa: PLC0415 - pyserial is rarely needed

        return SerialLink(url, callbacks)
    if url.is_udp:
        return UdpIn(url, callbacks) if url.listens else UdpOut(url, callbacks, vehicles)
    tcp_link = TcpIn if url.listens else TcpOut
    return tcp_link(url, callbacks, single_vehicle=len(vehicles) == 1)
