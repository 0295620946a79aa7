"""A bug on the receive path ends the simulator; it does not go on with a vehicle that answers nothing."""

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


class Broken(Fleet):
    """Every byte that comes in meets a bug."""

    def receive(self, *_data: Any, **_how: Any) -> Frames:
        raise ZeroDivisionError("a bug")


def test_a_bug_on_the_receive_path_stops_the_server() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("127.0.0.1", 0))
        station.settimeout(LIMIT_S)
        url = parse_url(f"udpout:127.0.0.1:{station.getsockname()[1]}")
        said: list[str] = []
        fleet = Broken(default_scenario(1, home=(46.0, 14.5, 300.0)))
        server = Server(fleet, [url], RealTime(1.0, said.append), warn=said.append)

        async def serve_and_speak() -> None:
            async with asyncio.timeout(LIMIT_S):
                serving = asyncio.create_task(server.run())
                loop = asyncio.get_running_loop()
                _, address = await loop.run_in_executor(None, station.recvfrom, 4096)
                station.sendto(b"\xfd", address)
                await serving

        with pytest.raises(ZeroDivisionError, match="a bug"):
            asyncio.run(serve_and_speak())
