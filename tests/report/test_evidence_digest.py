"""The digest of a run from its chain and its tlogs."""

from __future__ import annotations

from typing import Any

import pytest
from evidence_files import ARM, DISARM, HOLD, chained, entries, tlog
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.report.evidence.chain import check
from swarmctl.report.evidence.commands import UNRECORDED, content
from swarmctl.report.evidence.digest import VehicleDigest, digest

GUIDED, AUTO, LOITER = 4, 3, 5
AIR, GROUND = mavlink.MAV_LANDED_STATE_IN_AIR, mavlink.MAV_LANDED_STATE_ON_GROUND
START = mavlink.MAVLink_command_long_message(1, 1, 300, 0, 0, 0, 0, 0, 0, 0, 0)
COUNT = mavlink.MAVLink_mission_count_message(1, 1, 2)
ACCEPTED, AGAIN = (mavlink.MAVLink_mission_ack_message(255, 190, result) for result in (0, 13))


def beat(mode: int, *, armed: bool = False) -> Any:
    return mavlink.MAVLink_heartbeat_message(2, 3, 1 | armed * 128, mode, 3, 3)


def landed(state: int) -> Any:
    return mavlink.MAVLink_extended_sys_state_message(0, state)


def ack(command: int, result: int = 0) -> Any:
    return mavlink.MAVLink_command_ack_message(command, result)


def item(seq: int) -> Any:
    return mavlink.MAVLink_mission_item_int_message(1, 1, seq, 6, 16, 0, 1, 0, 0, 0, 0, 46, 14, 2)


def digested(*wire: Any, cut: int = 0, from_sender: int = 1) -> VehicleDigest:
    """Return the digest of messages on the wire; those with a target system are the station's.

    `cut`: number of messages that the end of the tlog lacks
    """
    is_sent = [message for message in wire if getattr(message, "target_system", 0) == 1]
    recorded = [message for message in is_sent if message.get_type() not in UNRECORDED]
    commands = [("command", content(message, byte_wise=False)) for message in recorded]
    log = tlog(
        *((255 if message in is_sent else from_sender, message) for message in wire[: len(wire) - cut])
    )
    return digest(check(chained(entries(*commands))), {"alpha": log})["alpha"]


def test_commands_are_paired_with_answers_and_effects() -> None:
    found = digested(
        beat(0), HOLD, ack(176), beat(GUIDED), ARM, ack(400, 4), ARM, beat(LOITER), beat(LOITER)
    )  # fmt: skip
    mode, arming = found.rows["DO_SET_MODE"], found.rows["COMPONENT_ARM_DISARM"]
    assert (mode.sent, mode.answers, mode.unanswered, mode.effects) == (1, {"ACCEPTED": 1}, 0, {"GUIDED": 1})
    assert (arming.sent, arming.refused, arming.unanswered, arming.effects) == (2, 1, 1, {})
    assert found.unasked == {"mode LOITER": 1}


def test_an_answer_to_a_repeated_item_ends_no_upload() -> None:
    found = digested(COUNT, item(0), AGAIN, item(1), ACCEPTED, COUNT)
    assert found.rows["MISSION_ITEM_INT"].sent == 2
    row = found.rows["MISSION_COUNT"]
    assert (row.sent, row.unanswered, row.refused) == (2, 1, 0)
    assert row.answers == {"INVALID_SEQUENCE": 1, "ACCEPTED": 1}


def test_only_requested_parameters_count_as_answers() -> None:
    value = mavlink.MAVLink_param_value_message(b"FS_GCS_ENABLE", 1.0, 9, 1, 0)
    asks = mavlink.MAVLink_param_set_message(1, 1, b"FS_GCS_ENABLE", 1.0, 9)
    assert digested(value, asks, value).rows["PARAM_SET"].answers == {"PARAM_VALUE": 1}


@pytest.mark.parametrize("is_landed_first", [False, True])
def test_a_disarming_after_a_landing_is_expected(is_landed_first: bool) -> None:
    down = [beat(AUTO), landed(GROUND)]
    found = digested(
        START, beat(AUTO, armed=True), landed(AIR), *(reversed(down) if is_landed_first else down)
    )
    assert (found.unasked, found.n_disarmed_on_ground) == ({}, 1)


def test_a_disarming_in_the_air_is_unexpected_unless_it_was_commanded() -> None:
    flies = (START, beat(AUTO, armed=True), landed(AIR))
    assert digested(*flies, beat(AUTO)).unasked == {"armed False": 1}
    found = digested(*flies, DISARM, beat(AUTO))
    assert (found.unasked, found.rows["COMPONENT_ARM_DISARM"].effects) == ({}, {"False": 1})


def test_a_change_before_a_command_is_not_its_effect() -> None:
    """Order on the wire decides; on the virtual clock all of it has the same time."""
    found = digested(beat(0), beat(GUIDED), HOLD, ack(176))
    assert (found.unasked, found.rows["DO_SET_MODE"].effects) == ({"mode GUIDED": 1}, {})


def test_commands_after_the_end_of_the_tlog_count_without_answers() -> None:
    row = digested(beat(0), HOLD, ack(176), HOLD, ack(176), cut=2).rows["DO_SET_MODE"]
    assert (row.sent, row.answers, row.unanswered) == (2, {"ACCEPTED": 1}, 1)


def test_messages_of_another_system_and_damaged_bytes_are_no_answers() -> None:
    assert digested(HOLD, ack(176), from_sender=7).rows["DO_SET_MODE"].unanswered == 1
    whole = tlog((255, HOLD), (1, ack(176)))
    checked = check(chained(entries(("command", content(HOLD, byte_wise=False)))))
    for end in range(len(whole)):
        for damaged in (whole[:end], whole[:end] + b"\xff" + whole[end + 1 :]):
            assert digest(checked, {"alpha": damaged})["alpha"].rows["DO_SET_MODE"].sent == 1
