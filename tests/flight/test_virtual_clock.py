"""The virtual clock: waits take no time, and every run has the same order of events."""

from __future__ import annotations

import asyncio

import pytest

from swarmctl.flight.virtual_clock import Stalled, run_virtual


def test_an_hour_passes_at_once_and_in_order() -> None:
    async def main() -> list[tuple[float, str]]:
        loop, seen = asyncio.get_running_loop(), []

        async def wait(name: str, seconds: float) -> None:
            await asyncio.sleep(seconds)
            seen.append((loop.time(), name))

        await asyncio.gather(wait("long", 3600.0), wait("short", 0.5), wait("also short", 0.5))
        return seen

    assert run_virtual(main()) == [(0.5, "short"), (0.5, "also short"), (3600.0, "long")]


def test_time_outs_fire_on_the_virtual_clock() -> None:
    async def main() -> float:
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(10.0):
                await asyncio.sleep(11.0)
        return asyncio.get_running_loop().time()

    assert run_virtual(main()) == pytest.approx(10.0)


def test_a_wait_without_any_timer_is_a_bug() -> None:
    async def main() -> None:
        await asyncio.Event().wait()

    with pytest.raises(Stalled):
        run_virtual(main())
