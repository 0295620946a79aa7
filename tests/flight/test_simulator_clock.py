"""The ground station steps the simulator's clock: the pace, and the wait for a busy ground station."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import pytest

from swarmctl.flight.simulator import CATCH_UP_S, STEP_S, step_clock
from swarmctl.flight.virtual_clock import run_virtual

SPEEDUP = 10.0


class SteppedSimulator:
    """The simulator's ends of both pipes; it answers each step after `answer_s(now)`."""

    def __init__(self, answer_s: Callable[[float], float] = lambda _now: 0.0) -> None:
        self.answers = asyncio.StreamReader()
        self.steps: list[tuple[float, float]] = []
        """loop time of each step, and the clock after it [s]"""
        self._answer_s = answer_s

    @property
    def clock_s(self) -> float:
        return self.steps[-1][1] if self.steps else 0.0

    def write(self, data: bytes) -> None:
        word, seconds = data.split()
        assert word == b"step"
        loop = asyncio.get_running_loop()
        self.steps.append((loop.time(), self.clock_s + float(seconds)))
        answer = f"at {self.clock_s:g}\n".encode()
        loop.call_later(self._answer_s(loop.time()), self.answers.feed_data, answer)

    async def drain(self) -> None: ...


def stepped(
    for_s: float,
    *,
    speedup: float = SPEEDUP,
    answer_s: Callable[[float], float] = lambda _now: 0.0,
    is_busy: Callable[[float], bool] = lambda _now: False,
) -> SteppedSimulator:
    """Return the simulator after `for_s` of the loop's time."""

    async def main() -> SteppedSimulator:
        loop = asyncio.get_running_loop()
        simulator = SteppedSimulator(answer_s)
        steps = step_clock(
            simulator,  # type: ignore[arg-type]
            simulator.answers,
            lambda _line: None,
            speedup,
            lambda: is_busy(loop.time()),
        )
        task = asyncio.create_task(steps)
        await asyncio.sleep(for_s)
        task.cancel()
        return simulator

    return run_virtual(main())


@pytest.mark.parametrize("speedup", [1.0, 10.0, 100.0])
def test_the_speedup_is_kept_while_the_ground_station_keeps_up(speedup: float) -> None:
    assert stepped(20.0, speedup=speedup).clock_s == pytest.approx(20.0 * speedup, abs=2 * STEP_S)


@pytest.mark.parametrize("stall_s", [1.0, 5.0, 20.0])
def test_the_vehicles_stand_still_while_telemetry_waits_in_the_ground_station(stall_s: float) -> None:
    until_s = 3.0 + stall_s
    simulator = stepped(until_s + 5.0, is_busy=lambda now: 3.0 <= now < until_s)
    assert [at_s for at_s, _ in simulator.steps if 3.01 < at_s < until_s] == []
    assert simulator.clock_s == pytest.approx(8.0 * SPEEDUP, abs=CATCH_UP_S * SPEEDUP + 2 * STEP_S)


def test_a_slow_simulator_is_not_hurried_afterwards() -> None:
    simulator = stepped(20.0, answer_s=lambda now: 5.0 if 2.0 <= now < 2.01 else 0.0)
    in_a_second = [clock_s for at_s, clock_s in simulator.steps if at_s <= 8.0][-1] - 2.0 * SPEEDUP
    assert in_a_second <= (1.0 + CATCH_UP_S) * SPEEDUP + 3 * STEP_S


def test_other_output_goes_to_the_log_and_the_end_of_output_ends_the_steps() -> None:
    logged: list[bytes] = []

    async def main() -> None:
        simulator = SteppedSimulator()
        simulator.answers.feed_data(b"sim_vehicle: 5 copters\n")
        loop = asyncio.get_running_loop()
        loop.call_later(1.0, simulator.answers.feed_eof)
        await step_clock(simulator, simulator.answers, logged.append, SPEEDUP, lambda: False)  # type: ignore[arg-type]

    run_virtual(main())
    assert logged == [b"sim_vehicle: 5 copters\n"]
