"""Entries from messages on the wire, and their digest."""

from __future__ import annotations

import math
import struct

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.report.evidence.digest import digest
from swarmctl.report.evidence.traffic import Traffic, arms

ARM = mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0)
DISARM = mavlink.MAVLink_command_long_message(
    1, 1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 0, 0, 0, 0, 0, 0, 0
)


def item(seq: int, lat: int = 460000000, param4: float = 0.0):
    return mavlink.MAVLink_mission_item_int_message(1, 1, seq, 6, 16, 0, 1, 0, 0, 0, param4, lat, 1, 2.0)


def test_a_command_is_named_with_its_parameters_and_its_answer() -> None:
    traffic = Traffic()
    ((kind, what),) = traffic.sent(ARM)
    assert kind == "command"
    assert (what["message"], what["command"], what["param1"]) == ("COMMAND_LONG", "COMPONENT_ARM_DISARM", 1)
    assert "target_system" not in what
    ((kind, what),) = traffic.received(mavlink.MAVLink_command_ack_message(400, 4))
    expected = {"message": "COMMAND_ACK", "command": "COMPONENT_ARM_DISARM", "result": "FAILED"}
    assert (kind, what) == ("acknowledgement", expected)


def test_only_arming_messages_count_as_arming() -> None:
    assert arms(ARM)
    assert not arms(DISARM)
    assert arms(mavlink.MAVLink_command_long_message(1, 1, 300, 0, 0, 0, 0, 0, 0, 0, 0))
    assert not arms(mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, 4, 0, 0, 0, 0, 0))
    assert arms(mavlink.MAVLink_command_int_message(1, 1, 0, 400, 0, 0, 1, 0, 0, 0, 0, 0, 0))


def test_an_upload_is_recorded_as_its_announcement_and_one_entry_of_all_items() -> None:
    traffic = Traffic()
    assert [w["message"] for _, w in traffic.sent(mavlink.MAVLink_mission_count_message(1, 1, 3))] == [
        "MISSION_COUNT"
    ]
    for seq in (0, 1, 1, 2):
        assert traffic.sent(item(seq)) == []
        assert traffic.received(mavlink.MAVLink_mission_request_message(255, 190, seq)) == []
    items, ack = traffic.received(mavlink.MAVLink_mission_ack_message(255, 190, 0))
    assert items[0] == "command"
    assert (items[1]["items"], items[1]["of"], items[1]["mission_type"]) == (3, 3, "MISSION")
    assert ack == (
        "acknowledgement",
        {"message": "MISSION_ACK", "mission_type": "MISSION", "result": "ACCEPTED"},
    )
    late = traffic.received(mavlink.MAVLink_mission_ack_message(255, 190, 1))
    assert [kind for kind, _ in late] == ["acknowledgement"]
    other = Traffic()
    other.sent(mavlink.MAVLink_mission_count_message(1, 1, 3))
    for seq in (2, 0, 1):
        other.sent(item(seq, 460000001 if seq == 2 else 460000000))
    assert other.unrecorded_entries()[0][1]["sha256"] != items[1]["sha256"]


def test_an_answer_to_a_repeated_item_ends_no_upload() -> None:
    traffic = Traffic()
    traffic.sent(mavlink.MAVLink_mission_count_message(1, 1, 2))
    traffic.sent(item(0))
    ((kind, what),) = traffic.received(mavlink.MAVLink_mission_ack_message(255, 190, 13))
    assert (kind, what["result"]) == ("acknowledgement", "INVALID_SEQUENCE")
    traffic.sent(item(1))
    (_, items), _ = traffic.received(mavlink.MAVLink_mission_ack_message(255, 190, 0))
    assert (items["items"], items["of"]) == (2, 2)


def test_a_read_back_is_recorded_with_the_acknowledgement_that_ends_it() -> None:
    traffic = Traffic()
    traffic.sent(mavlink.MAVLink_mission_request_list_message(1, 1))
    traffic.received(mavlink.MAVLink_mission_count_message(255, 190, 2))
    for seq in range(2):
        assert traffic.sent(mavlink.MAVLink_mission_request_int_message(1, 1, seq)) == []
        traffic.received(item(seq, param4=math.nan))
    ((kind, what),) = traffic.sent(mavlink.MAVLink_mission_ack_message(1, 1, 0))
    assert kind == "command"
    assert (what["read"]["items"], what["read"]["of"]) == (2, 2)


def test_an_unacknowledged_upload_is_recorded_at_the_end() -> None:
    traffic = Traffic()
    traffic.sent(mavlink.MAVLink_mission_count_message(1, 1, 3))
    traffic.sent(item(0))
    ((_, what),) = traffic.unrecorded_entries()
    assert (what["items"], what["of"]) == (1, 3)
    assert traffic.unrecorded_entries() == []


def test_only_requested_parameters_count_as_answers() -> None:
    traffic = Traffic()
    value = mavlink.MAVLink_param_value_message(b"FS_GCS_ENABLE", 1.0, 9, 1, 0)
    assert traffic.received(value) == []
    traffic.sent(mavlink.MAVLink_param_set_message(1, 1, b"FS_GCS_ENABLE", 1.0, 9))
    ((kind, what),) = traffic.received(value)
    assert (kind, what["param_id"], what["param_value"]) == ("acknowledgement", "FS_GCS_ENABLE", 1.0)


def test_heartbeats_are_no_commands_and_a_signing_key_is_never_written() -> None:
    traffic = Traffic()
    assert traffic.sent(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)) == []
    ((_, what),) = traffic.sent(mavlink.MAVLink_setup_signing_message(1, 1, [7] * 32, 5))
    assert what == {"message": "SETUP_SIGNING", "initial_timestamp": 5}


def entry(kind: str, **what: object) -> dict[str, object]:
    return {"kind": kind, "vehicle": "uav1", "what": what}


def test_a_digest_pairs_commands_with_answers_and_effects() -> None:
    summary = digest(
        [
            entry("command", command="DO_SET_MODE"),
            entry("acknowledgement", message="COMMAND_ACK", command="DO_SET_MODE", result="ACCEPTED"),
            entry("effect", changed="mode", **{"from": "STABILIZE", "to": "GUIDED"}),
            entry("command", command="COMPONENT_ARM_DISARM"),
            entry("acknowledgement", message="COMMAND_ACK", command="COMPONENT_ARM_DISARM", result="FAILED"),
            entry("command", command="COMPONENT_ARM_DISARM"),
            entry("effect", changed="mode", **{"from": "GUIDED", "to": "LOITER"}),
            entry("waiver", check="gps", because="indoors"),
        ]
    )
    mode, arming = summary.rows
    assert (mode.sent, dict(mode.answers), mode.unanswered, dict(mode.effects)) == (
        1, {"ACCEPTED": 1}, 0, {"mode GUIDED": 1},
    )  # fmt: skip
    assert (arming.sent, arming.refused, arming.unanswered, dict(arming.effects)) == (2, 1, 1, {})
    assert summary.unasked == {"uav1": {"mode LOITER": 1}}
    assert [e["kind"] for e in summary.people] == ["waiver"]


def test_a_px4_integer_parameter_is_recorded_as_its_value() -> None:
    three = struct.unpack("<f", struct.pack("<i", 3))[0]
    asks = mavlink.MAVLink_param_set_message(1, 1, b"NAV_DLL_ACT", three, mavlink.MAV_PARAM_TYPE_INT32)
    value = mavlink.MAVLink_param_value_message(
        b"NAV_DLL_ACT", three, mavlink.MAV_PARAM_TYPE_INT32, 1, 0xFFFF
    )
    value.pack(mavlink.MAVLink(None, 1, 1))
    traffic = Traffic()
    traffic.received(mavlink.MAVLink_heartbeat_message(2, mavlink.MAV_AUTOPILOT_PX4, 0, 0, 3, 3))
    ((_, command),) = traffic.sent(asks)
    ((_, answer),) = traffic.received(value)
    assert (command["param_value"], answer["param_value"]) == (3.0, 3.0)


def test_an_ardupilot_integer_parameter_is_a_float() -> None:
    traffic = Traffic()
    traffic.received(mavlink.MAVLink_heartbeat_message(2, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 0, 0, 3, 3))
    asks = mavlink.MAVLink_param_set_message(1, 1, b"FENCE_ENABLE", 1.0, mavlink.MAV_PARAM_TYPE_INT8)
    ((_, command),) = traffic.sent(asks)
    assert command["param_value"] == 1.0


def effect(changed: str, before: object, after: object) -> dict[str, object]:
    return {"vehicle": "alpha", "kind": "effect", "what": {"changed": changed, "from": before, "to": after}}


@pytest.mark.parametrize("turned", [False, True], ids=["landed first", "disarmed first"])
def test_a_disarming_after_a_landing_is_expected(turned: bool) -> None:
    down = [effect("landed", "IN_AIR", "ON_GROUND"), effect("armed", True, False)]
    summary = digest([effect("landed", "UNDEFINED", "IN_AIR"), *(reversed(down) if turned else down)])
    assert summary.unasked == {}
    assert summary.n_disarmed_on_ground == {"alpha": 1}


def test_a_disarming_in_the_air_is_unexpected() -> None:
    summary = digest([effect("landed", "UNDEFINED", "IN_AIR"), effect("armed", True, False)])
    assert summary.unasked == {"alpha": {"armed False": 1}}


def partial(seq: int):
    return mavlink.MAVLink_mission_write_partial_list_message(1, 1, seq, seq)


def appended(traffic: Traffic, seqs: list[int], *, copies: int = 1) -> list[tuple[str, dict[str, object]]]:
    entries = []
    for seq in seqs:
        for message in (*[partial(seq)] * copies, *[item(seq)] * copies):
            entries += traffic.sent(message)
        entries += traffic.received(mavlink.MAVLink_mission_ack_message(255, 190, 0))
    return entries


@pytest.mark.parametrize("copies", [1, 3])
def test_items_appended_one_by_one_are_one_entry(copies: int) -> None:
    traffic = Traffic()
    ((kind, what),) = appended(traffic, [11, 12, 13], copies=copies)
    assert (kind, what["message"], what["start_index"]) == ("command", "MISSION_WRITE_PARTIAL_LIST", 11)
    items, answers, asks = traffic.sent(mavlink.MAVLink_mission_request_list_message(1, 1))
    assert items[0] == "command"
    assert {k: items[1][k] for k in ("message", "first", "items", "of")} == {
        "message": "MISSION_ITEM_INT", "first": 11, "items": 3, "of": 3,
    }  # fmt: skip
    assert answers == (
        "acknowledgement",
        {"message": "MISSION_ACK", "mission_type": "MISSION", "result": "ACCEPTED", "times": 3},
    )
    assert asks[1]["message"] == "MISSION_REQUEST_LIST"
    other = Traffic()
    other.sent(partial(11))
    for seq in (13, 12, 11):
        other.sent(partial(seq))
        other.sent(item(seq))
    assert other.unrecorded_entries()[0][1]["sha256"] == items[1]["sha256"], (
        "the hash does not depend on the order"
    )


def test_a_request_between_partial_lists_does_not_divide_them_and_an_order_does() -> None:
    traffic = Traffic()
    appended(traffic, [11, 12])
    traffic.sent(mavlink.MAVLink_mission_request_list_message(1, 1))
    assert appended(traffic, [12, 13]) == []
    ((_, items), (_, answers), (_, order)) = traffic.sent(DISARM)
    assert (items["first"], items["items"], items["of"]) == (11, 3, 3)
    assert answers["times"] == 2
    assert order["command"] == "COMPONENT_ARM_DISARM"
    ((_, begins),) = appended(traffic, [14])
    assert begins["start_index"] == 14
    assert traffic.unrecorded_entries()[0][1]["first"] == 14


def test_refused_partial_lists_are_recorded_with_their_items() -> None:
    traffic = Traffic()
    appended(traffic, [11])
    assert traffic.received(mavlink.MAVLink_mission_ack_message(255, 190, 1)) == []
    entries = traffic.unrecorded_entries()
    assert [
        (what.get("result"), what.get("times")) for kind, what in entries if kind == "acknowledgement"
    ] == [
        ("ACCEPTED", 1),
        ("ERROR", 1),
    ]
    traffic.sent(mavlink.MAVLink_mission_ack_message(1, 1, 0))
    ((kind, _),) = traffic.received(mavlink.MAVLink_mission_ack_message(255, 190, 1))
    assert kind == "acknowledgement", "after the transfer an acknowledgement is a separate entry"


def test_a_running_transfer_is_recorded_so_far_and_only_once() -> None:
    traffic = Traffic()
    traffic.sent(mavlink.MAVLink_mission_count_message(1, 1, 3))
    counts = []
    for seqs in ((0,), (0,), (1, 2)):
        for seq in seqs:
            traffic.sent(item(seq))
        counts.append([what["items"] for _, what in traffic.unrecorded_entries()])
    assert counts == [[1], [], [3]]
    assert [kind for kind, _ in traffic.received(mavlink.MAVLink_mission_ack_message(255, 190, 0))] == [
        "acknowledgement"
    ]


def test_a_digest_counts_a_transfer_of_many_lines_once() -> None:
    begins, items = entry("command", message="MISSION_COUNT"), entry("command", message="MISSION_ITEM_INT")
    accepted = entry("acknowledgement", message="MISSION_ACK", result="ACCEPTED")
    summary = digest([begins, items, items, accepted, begins, items, accepted, begins, items])
    row = summary.rows[1]
    assert (row.command, row.sent, dict(row.answers), row.unanswered) == (
        "MISSION_ITEM_INT", 3, {"ACCEPTED": 2}, 1,
    )  # fmt: skip
