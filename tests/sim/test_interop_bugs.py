"""A bug on the receive path ends the simulator."""

import asyncio
import socket
from typing import Any

import pytest

from sim_vehicle.fleet import Fleet
from sim_vehicle.links.url import parse_url
from sim_vehicle.scenarios import default_scenario
from sim_vehicle.serving.pace import RealTime
from sim_vehicle.serving.server import Server
from sim_vehicle.wire.outbox import Frames

pytestmark = pytest.mark.interop
LIMIT_S = 10.0


class BuggyFleet(Fleet):
    """A fleet with a bug on its receive path."""

    def receive(self, *_data: Any, **_how: Any) -> Frames:
        raise ZeroDivisionError("a bug")


def test_a_bug_on_the_receive_path_stops_the_server() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("127.0.0.1", 0))
        station.settimeout(LIMIT_S)
        url = parse_url(f"udpout:127.0.0.1:{station.getsockname()[1]}")
        warnings: list[str] = []
        fleet = BuggyFleet(default_scenario(1, home=(46.0, 14.5, 300.0)))
        server = Server(fleet, [url], RealTime(1.0, warnings.append), warn=warnings.append)

        async def serve_and_speak() -> None:
            async with asyncio.timeout(LIMIT_S):
                serving = asyncio.create_task(server.run())
                loop = asyncio.get_running_loop()
                _, address = await loop.run_in_executor(None, station.recvfrom, 4096)
                station.sendto(b"\xfd", address)
                await serving

        with pytest.raises(ZeroDivisionError):
            asyncio.run(serve_and_speak())
