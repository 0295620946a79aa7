"""The age of telemetry by the vehicle's clock: late links, backlogs, slow and fast simulators."""

from __future__ import annotations

import pytest
from flying_bench import BOTH, FlyingBench, plan
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.procedures import basic
from swarmctl.mavlink.telemetry.vehicle_clock import ASK_FROM_S, VehicleClock

BOOT_S = 70.0
"""time of this program's clock at the vehicle's boot"""


class Sender:
    """A vehicle whose clock runs `rate` times as fast as this program's; answers take `answer_s`."""

    def __init__(self, rate: float = 1.0, answer_s: float = 0.0) -> None:
        self.clock = VehicleClock()
        self.rate, self.answer_s = rate, answer_s
        self._answers: list[tuple[float, mavlink.MAVLink_timesync_message]] = []

    def sends(self, sent_s: float, delay_s: float = 0.0) -> float:
        """Return the age after the receipt of a message; questions get their answers."""
        now = sent_s + delay_s
        while self._answers and self._answers[0][0] <= now:
            self.clock.receive_answer(self._answers.pop(0)[1], now)
        self.clock.receive((sent_s - BOOT_S) * self.rate, now)
        age_s = self.clock.age_s(now)
        for question in self.clock.questions(now):
            tc1 = round((now - BOOT_S) * self.rate * 1e9)
            answer = mavlink.MAVLink_timesync_message(tc1, question.ts1)
            self._answers.append((now + self.answer_s, answer))
        return age_s


@settings(max_examples=examples(500), deadline=None)
@given(st.lists(st.tuples(st.floats(0.0, 2.0), st.floats(0.0, 30.0)), min_size=1, max_size=30))
def test_the_age_is_exact_but_for_the_least_delay(messages: list[tuple[float, float]]) -> None:
    """A message arrives after its delay, and after the messages before."""
    sender, sent_s, now, least_s = Sender(answer_s=1e9), BOOT_S, 0.0, 99.0
    for pause_s, delay_s in messages:
        sent_s += pause_s
        now = max(now, sent_s + delay_s)
        least_s = min(least_s, now - sent_s)
        assert sender.sends(sent_s, now - sent_s) == pytest.approx(now - sent_s - least_s, abs=1e-5)


def test_a_backlog_shows_its_age_to_the_last_message() -> None:
    sender = Sender(answer_s=20.0)
    for tenth in range(100):
        sender.sends(BOOT_S + tenth / 10)
    begin_s, end_s = BOOT_S + 10.0, BOOT_S + 30.0
    for tenth in range(200):
        sent_s = begin_s + tenth / 10
        assert sender.sends(sent_s, end_s - sent_s) == pytest.approx(end_s - sent_s)
    assert sender.sends(end_s) == 0.0


@pytest.mark.parametrize(
    ("rate", "greatest_s"), [(0.5, 0.8), (0.95, 0.25), (0.99, 0.25), (1.0, 0.1), (10.0, 0.1)]
)
def test_a_simulator_that_is_slower_or_faster_than_real_time_is_not_taken_for_late(
    rate: float, greatest_s: float
) -> None:
    sender = Sender(rate, answer_s=0.1)
    assert max(sender.sends(BOOT_S + tenth / 10, 0.05) for tenth in range(1, 2000)) <= greatest_s


def test_answers_to_another_stations_questions_count_for_nothing() -> None:
    clock = VehicleClock()
    clock.receive(10.0, 100.0)
    clock.receive(10.5, 105.0)
    clock.receive_answer(mavlink.MAVLink_timesync_message(round(10.6e9), round(104.9e9)), 105.0)
    assert clock.age_s(105.0) == pytest.approx(4.5)


def test_without_a_question_due_nothing_is_sent() -> None:
    clock = VehicleClock()
    clock.receive(10.0, 100.0)
    assert clock.questions(100.0 + ASK_FROM_S) == []
    assert len(clock.questions(100.1 + ASK_FROM_S)) == 1
    assert clock.questions(100.2 + ASK_FROM_S) == []


@BOTH
@pytest.mark.parametrize("stall_s", [5.0, 20.0])
def test_a_command_waits_until_the_backlog_of_a_stall_is_processed(personality: str, stall_s: float) -> None:
    """A heartbeat of the backlog is no new heartbeat."""
    bench = FlyingBench(personality).flying(plan(north=8))
    bench.stalls = [(bench.now, bench.now + stall_s + 0.5)]
    # The pilot's mode is in the last two seconds of the backlog.
    bench.run(stall_s - 2.0)
    bench.another_sets_mode(bench.session.dialect.return_mode)
    bench.run(2.0)
    assert bench.is_stalled
    n_before = bench.commands.count(mavlink.MAV_CMD_DO_SET_MODE)
    done = bench.do("hold", lambda c: basic.hold(c, check_mode_first=True))
    assert "[taken-over]" in (done.failure or ""), done
    assert bench.commands.count(mavlink.MAV_CMD_DO_SET_MODE) == n_before
