"""`swarmctl dashboard`: orders go only to the flight of the record, and a taken port has its address."""

from __future__ import annotations

import asyncio
import signal
import socket
from pathlib import Path
from typing import Any

import pytest
from flights import small
from swarmctl_process import StartDashboard, address_of, swarmctl

from swarmctl.core.messages import GiveOrder
from swarmctl.dashboard import server
from swarmctl.dashboard.orders_panel import NotSent
from swarmctl.report.record import Recorder


@pytest.fixture
def recorder(tmp_path: Path) -> Recorder:
    return Recorder(tmp_path / "run.mcap", small(), 0)


@pytest.fixture
def sent_by(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Return the list of senders with which the page would be served."""
    senders: list[Any] = []

    async def serve(_sources: Any, _where: Any, _announce: Any, send: Any = None, _tiles: Any = None) -> None:
        senders.append(send)

    monkeypatch.setattr(server, "serve", serve)
    return senders


def test_the_page_of_a_finished_run_has_no_orders(
    recorder: Recorder, sent_by: list[Any], tmp_path: Path
) -> None:
    recorder.close()
    assert swarmctl("dashboard", tmp_path, "--live").exit_code == 0
    assert sent_by == [None]


def test_a_flight_in_progress_gets_orders_until_its_end(
    recorder: Recorder, sent_by: list[Any], tmp_path: Path
) -> None:
    assert swarmctl("dashboard", tmp_path, "--live").exit_code == 0
    recorder.close()
    (send,) = sent_by
    with pytest.raises(NotSent, match=r"\[flight-ended\]"):
        asyncio.run(send(GiveOrder(None, "hold")))


def test_an_interrupt_is_the_normal_end(
    recorder: Recorder, start_dashboard: StartDashboard, tmp_path: Path
) -> None:
    recorder.close()
    process = start_dashboard("dashboard", tmp_path)
    address_of(process)
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=30.0) == 0


def test_a_taken_port_is_told_with_its_address(recorder: Recorder, tmp_path: Path) -> None:
    recorder.close()
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        result = swarmctl("dashboard", tmp_path, "--port", str(port))
    assert result.exit_code == 1
    assert f"127.0.0.1:{port}" in result.stderr


def test_another_failure_of_the_system_is_not_a_taken_port(
    recorder: Recorder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder.close()

    async def serve(*_: Any) -> None:
        raise OSError(24, "Too many open files")

    monkeypatch.setattr(server, "serve", serve)
    assert isinstance(swarmctl("dashboard", tmp_path).exception, OSError)
