"""The router of a star: the names of clients that connect and disconnect."""

from __future__ import annotations

import asyncio
import datetime as dt
import os
import signal
from pathlib import Path

import pytest
from zenoh_nodes import here

from swarmctl.bus.transports import zenoh_config
from swarmctl.bus.transports.zenoh import ZenohBus
from swarmctl.security.issue import make_keys
from swarmctl.security.participant import load_keyring
from swarmctl.station import router


@pytest.mark.parametrize(
    ("participant", "shown_as"),
    [("uav1", "alpha (uav1)"), ("uav2", "uav2"), ("operator", "operator")],
)
def test_a_client_is_named_as_in_the_configuration(participant: str, shown_as: str, tmp_path: Path) -> None:
    now = dt.datetime.now(dt.UTC)
    make_keys(tmp_path, ["uav1", "uav2", "operator", "router"], 5, now)
    at = here("tls")
    configuration = zenoh_config.router(at, "test", [1, 2], load_keyring(tmp_path, "router", now).credentials)
    lines: list[str] = []
    has_come = asyncio.Event()

    def say(text: str) -> None:
        lines.append(text)
        if text.endswith("has connected"):
            has_come.set()

    async def scene() -> None:
        routing = asyncio.create_task(router.run(configuration, say, {1: "alpha", 2: "uav2"}))
        while not lines:  # noqa: ASYNC110 - it listens
            await asyncio.sleep(0.05)
        with ZenohBus(zenoh_config.client(at, load_keyring(tmp_path, participant, now).credentials)):
            async with asyncio.timeout(20.0):
                await has_come.wait()
        os.kill(os.getpid(), signal.SIGINT)
        await routing

    asyncio.run(scene())
    assert lines[0] == f"listening at {at}"
    assert lines[1].startswith(f"{shown_as} at tls/127.0.0.1:")
