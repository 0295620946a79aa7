"""Rows of (state, input, now) -> (output, deadline): waits, requests and their common rules."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from vehicle_texts import ITEMS, PEER, ack, kinds

from swarmctl.mavlink.protocol.command import Command
from swarmctl.mavlink.protocol.conversation import ConversationState, IllegalEvent
from swarmctl.mavlink.protocol.mission_download import Download
from swarmctl.mavlink.protocol.mission_upload import Upload
from swarmctl.mavlink.protocol.wait import RequestUntil, WaitUntil, collect_messages, wait


def test_a_wait_ends_at_its_condition_or_its_time_out():
    seen = []
    until = WaitUntil(lambda: bool(seen), 3.0)
    until.start(10.0)
    assert (until.result, until.next_deadline) == (None, 13.0)
    seen.append(1)
    until.receive(ack(1, 0), 11.0)
    assert until.result is True
    pause = wait(2.0)
    pause.start(0.0)
    pause.tick(1.9)
    assert pause.result is None
    pause.tick(2.0)
    assert pause.result is False


def test_a_request_waits_for_a_newer_heartbeat():
    beat = mavlink.MAVLink_heartbeat_message(2, 3, 81, 4, 3, 3)
    seen = [1]
    request_until = RequestUntil(PEER, lambda: bool(seen), 2.5)
    (request,) = request_until.start(10.0)
    assert (request.command, request.param1) == (512, 0.0)
    request_until.receive(ack(512, 0), 10.1)
    assert request_until.result is None
    seen.clear()
    request_until.receive(beat, 10.2)
    assert request_until.result is None
    assert (kinds(request_until.tick(11.0)), kinds(request_until.tick(12.0))) == (
        ["COMMAND_LONG"],
        ["COMMAND_LONG"],
    )
    assert (request_until.tick(12.5), request_until.result) == ([], False)
    again = RequestUntil(PEER, lambda: True, 2.5)
    again.start(0.0)
    again.receive(beat, 0.1)
    assert again.result is True


def test_missing_messages_are_requested_again_after_each_second_without_an_answer():
    pending = collect_messages(PEER, (148, 2), tries=3)
    assert [m.param1 for m in pending.start(0.0)] == [148.0, 2.0]
    assert pending.tick(0.5) == []
    assert [m.param1 for m in pending.tick(1.0)] == [148.0, 2.0]
    message = mavlink.MAVLink_autopilot_version_message(0, 1, 0, 0, 0, b"", b"", b"", 0, 0, 0)
    pending.receive(message, 1.5)
    assert pending.tick(2.0) == []
    assert [m.param1 for m in pending.tick(2.5)] == [2.0]
    assert (pending.tick(3.5), pending.result) == ([], {148: (message, 1.5)})


@pytest.mark.parametrize(
    "conversation",
    [
        Command(PEER, 300),
        Upload(PEER, ITEMS),
        Download(PEER),
        wait(1.0),
        collect_messages(PEER, (148,)),
        RequestUntil(PEER, bool, 1.0),
    ],
)
def test_an_illegal_event_names_the_state_and_late_messages_are_ignored(conversation):
    name = type(conversation).__name__
    with pytest.raises(IllegalEvent, match=f"{name}: receive while new"):
        conversation.receive(ack(300, 0), 0.0)
    conversation.start(0.0)
    with pytest.raises(IllegalEvent, match=f"{name}: start while waiting"):
        conversation.start(0.0)
    conversation.cancel(0.1)
    assert conversation.state is ConversationState.DONE
    assert conversation.receive(ack(300, 0), 0.2) == []
    assert conversation.tick(99.0) == []
    assert (conversation.result, conversation.next_deadline) == (None, None)
