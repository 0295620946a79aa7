"""Rows of (state, input, now) -> (output, deadline): a command."""

from __future__ import annotations

import pytest
from vehicle_texts import PEER, ack

from swarmctl.mavlink.protocol.command import Command, CommandOutcome


def started_command() -> Command:
    command = Command(PEER, 300)
    command.start(0.0)
    return command


@pytest.mark.parametrize(
    ("result", "outcome", "text"),
    [
        (0, CommandOutcome.ACCEPTED, "MISSION_START: ACCEPTED"),
        (4, CommandOutcome.REFUSED, "MISSION_START: FAILED"),
        (99, CommandOutcome.REFUSED, "MISSION_START: MAV_RESULT 99"),
    ],
)
def test_a_command_ends_with_the_vehicles_result_by_name(result, outcome, text):
    command = started_command()
    command.receive(ack(300, result), 0.1)
    assert (command.result.outcome, command.result.text) == (outcome, text)
    assert command.next_deadline is None


def test_a_command_is_sent_once_and_waits_a_second_for_its_answer():
    command = Command(PEER, 300, confirmation=3)
    assert [m.confirmation for m in command.start(0.0)] == [3]
    assert command.next_deadline == 1.0
    assert command.tick(1.0) == []
    assert (command.result.outcome, command.result.text) == (
        CommandOutcome.NO_ANSWER,
        "MISSION_START: no answer",
    )


@pytest.mark.parametrize("other", [ack(301, 0), ack(300, 0, to=254)], ids=["other command", "other station"])
def test_an_acknowledgement_of_another_command_is_ignored(other):
    command = started_command()
    command.receive(other, 0.1)
    assert command.result is None
    assert command.next_deadline == 1.0


def test_in_progress_extends_the_wait():
    command = started_command()
    command.receive(ack(300, 5), 0.5)
    assert command.next_deadline == 10.5
    command.receive(ack(300, 0), 1.7)
    assert command.result.outcome is CommandOutcome.ACCEPTED


def test_temporarily_rejected_ends_a_command_after_a_pause():
    command = started_command()
    command.receive(ack(300, 1), 0.6)
    assert (command.result, command.next_deadline) == (None, 1.6)
    command.tick(1.6)
    assert command.result.outcome is CommandOutcome.NOT_NOW
    assert not command.result.final


@pytest.mark.parametrize(("arm", "code"), [(0.0, 21196.0), (1.0, 2989.0)])
def test_forced_arming_and_disarming_cannot_be_written(arm, code):
    with pytest.raises(ValueError, match="param2 = "):
        Command(PEER, 400, arm, code)
