"""The virtual clock: waits take no time, and every run has the same order of events."""

from __future__ import annotations

import asyncio

import pytest

from swarmctl.flight.supervise import Backoff, retrying
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


@pytest.mark.parametrize(("failed", "delay_s"), [(1, 2.0), (2, 4.0), (3, 5.0), (4, None), (9, None)], ids=str)
def test_waits_grow_up_to_a_limit_and_then_the_policy_gives_up(failed: int, delay_s: float | None) -> None:
    assert Backoff(attempts=4, first_s=2.0, most_s=5.0).delay_s(failed) == delay_s


@pytest.mark.parametrize(("fails", "tries", "ends_s"), [(0, 1, 0.0), (1, 2, 2.0), (2, 3, 6.0), (5, 3, 6.0)])
def test_an_attempt_is_repeated_until_it_succeeds_or_the_policy_gives_up(
    fails: int, tries: int, ends_s: float
) -> None:
    made = 0

    async def attempt() -> str:
        nonlocal made
        made += 1
        if made <= fails:
            raise ConnectionError("not yet")
        return "done"

    async def main() -> tuple[str, float]:
        policy = Backoff(attempts=3, first_s=2.0)
        try:
            answer = await retrying(attempt, policy, ConnectionError)
        except ConnectionError as error:
            answer = str(error)
        return answer, asyncio.get_running_loop().time()

    answer, now = run_virtual(main())
    assert (answer, made) == ("done" if fails < 3 else "not yet", tries)
    assert now == pytest.approx(ends_s)
