"""The evidence of whole flights, compared with the messages on the wire."""

from __future__ import annotations

import asyncio
import datetime as dt
import json
import re
import struct
from collections import Counter
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from flights import Ui, fly, small
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from recorded import effects
from typer.testing import CliRunner, Result

from swarmctl.bus import keys
from swarmctl.bus.endpoint import BusEndpoint
from swarmctl.bus.transports.memory import MemoryBus
from swarmctl.cli.main import cli
from swarmctl.core import events as ev
from swarmctl.core.messages import SetWeights, VehicleAnswer
from swarmctl.core.threat import FiringStrength
from swarmctl.core.vehicle import Landed, VehicleState
from swarmctl.flight import app
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.preflight.waivers import parse_waivers
from swarmctl.report.evidence.chain import CheckedChain, canonical, check, sha256
from swarmctl.report.evidence.file import FILE_NAME
from swarmctl.report.evidence.story import event_entries, state_changes
from swarmctl.report.outcome import FlightReport
from swarmctl.security.issue import make_keys
from swarmctl.station import client

COMMAND_LONG = "COMMAND_LONG"
STATION = 255


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flown")
    assert fly(small(), folder).all_arrived
    return folder


def evidence(folder: Path) -> CheckedChain:
    with (folder / FILE_NAME).open("rb") as file:
        return check(file)


def sent_to(tlog: Path) -> list[Any]:
    """Return the ground station's messages from the tlog."""
    data, at, messages = tlog.read_bytes(), 0, []
    codec = mavlink.MAVLink(None)
    while at < len(data):
        _time, _magic, length = struct.unpack_from(">QBB", data, at)
        frame = data[at + 8 : at + 8 + 12 + length]
        at += 8 + 12 + length
        message = codec.decode(bytearray(frame))
        if message.get_srcSystem() == STATION and message.get_type() != "HEARTBEAT":
            messages.append(message)
    return messages


@pytest.mark.virtual
def test_the_evidence_of_a_flight_is_whole_and_names_the_run(flown: Path) -> None:
    checked = evidence(flown)
    assert checked.fault is None
    assert checked.closing == {"entries": len(checked.entries) - 1}
    assert checked.opened["run"] == "small"
    assert checked.opened["vehicles"] == {"uav1": 1, "uav2": 2, "uav3": 3}
    assert len(checked.opened["configuration_sha256"]) == 64


@pytest.mark.virtual
def test_every_command_on_the_wire_is_in_the_evidence(flown: Path) -> None:
    entries = evidence(flown).entries
    for name in ("uav1", "uav2", "uav3"):
        recorded = [e["what"] for e in entries if e["vehicle"] == name and e["kind"] == "command"]
        sent = sent_to(flown / f"{name}.tlog")
        commands = [m for m in sent if m.get_type() == COMMAND_LONG]
        assert [(m.param1, m.param2) for m in commands] == [
            (w["param1"], w["param2"]) for w in recorded if w["message"] == COMMAND_LONG
        ]
        kinds = Counter(m.get_type() for m in sent)
        told_of = Counter(w["message"] for w in recorded)
        for kind in ("MISSION_COUNT", "MISSION_REQUEST_LIST", "MISSION_ACK"):
            assert told_of[kind] == kinds[kind]
        items = sum(w["items"] for w in recorded if w["message"] == "MISSION_ITEM_INT")
        assert items == kinds["MISSION_ITEM_INT"] > 0


@pytest.mark.virtual
def test_a_changed_plan_is_recorded_before_its_upload_and_its_items_are_one_line(flown: Path) -> None:
    """The hash in the decision equals the hash of the plan in the record of the run."""
    entries, n_changes = evidence(flown).entries, 0
    plans = [(recorded["vehicle"], recorded["effect"]["plan"]) for recorded in effects(flown, "SwapMission")]
    for name in ("uav1", "uav2", "uav3"):
        own = [e["what"] for e in entries if e["vehicle"] == name]
        decided = [i for i, what in enumerate(own) if what.get("decided") == "mission"]
        assert [own[i]["sha256"] for i in decided] == [
            sha256(canonical(plan)) for uav, plan in plans if uav == name
        ]
        for begin, end in pairwise([*decided, len(own)]):
            goes = [w for w in own[begin:end] if w.get("mission_type") == "MISSION" and "read" not in w]
            names = [w["message"] for w in goes if w["message"] != "MISSION_REQUEST_LIST"]
            announces = "MISSION_COUNT" if begin == decided[0] else "MISSION_WRITE_PARTIAL_LIST"
            assert names == [announces, "MISSION_ITEM_INT", "MISSION_ACK"]
            n_changes += begin != decided[0]
    assert n_changes > 0


@pytest.mark.virtual
def test_arming_is_followed_by_its_acknowledgement_and_its_effect(flown: Path) -> None:
    story = [
        (e["kind"], e["what"].get("command") or e["what"].get("changed"), e["what"].get("to"))
        for e in evidence(flown).entries
        if e["vehicle"] == "uav2"
    ]
    armed = story.index(("command", "COMPONENT_ARM_DISARM", None))
    answered = story.index(("acknowledgement", "COMPONENT_ARM_DISARM", None))
    was_seen = story.index(("effect", "armed", True))
    assert armed < answered < was_seen
    assert story.index(("effect", "armed", False)) > story.index(("effect", "landed", "IN_AIR")) > was_seen


@pytest.mark.full
@pytest.mark.virtual
def test_operators_actions_are_in_the_evidence(tmp_path: Path) -> None:
    scenario = small(sensor={"source": "external"})
    station = client.FlightEndpoints("small", BusEndpoint("127.0.0.1", 7447))
    report = json.dumps({"version": 1, "cells": [[0, 0, False]], "source": "operator"}).encode()
    by_camera = json.dumps({"version": 1, "cells": [[0, 1, False]], "source": "camera"}).encode()
    waivers = parse_waivers(["battery:uav1"], ["uav1"])

    async def scene() -> FlightReport:
        bus = MemoryBus()
        flight = asyncio.create_task(
            app.fly(
                scenario,
                tmp_path,
                Ui(),
                clock="virtual",
                permission=lambda _: None,
                bus=bus,
                options=replace(app.DEFAULT_OPTIONS, waivers=waivers),
            )
        )
        await asyncio.sleep(30.0)
        await client.ask(bus, station, SetWeights((1,), w=1.0))
        for data in (report, by_camera):
            await bus.ask(keys.sensor_report("small", 2), data, 5.0)
        return await flight

    assert run_virtual(scene()).bug is None
    entries = evidence(tmp_path).entries
    asked = [(e["vehicle"], e["what"]["asks"]) for e in entries if e["kind"] == "operator"]
    assert asked == [("uav1", "weights"), ("uav2", "observe")]
    names = [e["what"].get("said") for e in entries if e["kind"] == "note" and e["vehicle"] == "uav2"]
    (by_camera_said,) = [text for text in names if text and text.startswith("camera ")]
    assert re.findall(r"\d+", by_camera_said) == ["1"]
    # No check failed, so no waiver was used.
    assert not [e for e in entries if e["kind"] == "waiver"]


@pytest.mark.virtual
@pytest.mark.parametrize("besides", [", router: tls/127.0.0.1:7447", ""], ids=["a router", "nothing else"])
def test_with_keys_the_operator_signs_the_evidence_of_one_process(besides: str, tmp_path: Path) -> None:
    keyring, runs = tmp_path / "keys", tmp_path / "runs"
    make_keys(keyring, ["operator"], 30, dt.datetime.now(dt.UTC))
    file = tmp_path / "small.yaml"
    file.write_text(
        "area: {origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 4, cols: 4, cell_size_m: 50}\n"
        "threats: {count: 1}\nsimulate: {count: 1}\n"
        f"communication: {{keys: '{keyring}'{besides}}}\n"
    )

    def swarmctl(*words: str) -> Result:
        return CliRunner().invoke(cli, words)

    flown = swarmctl("fly", "--config", str(file), "--clock", "virtual", "--out", str(runs))
    assert flown.exit_code == 0, flown.output
    (folder,) = runs.iterdir()
    audited = swarmctl("audit", str(folder), "--keys", str(keyring))
    assert audited.exit_code == 0, audited.output
    assert " operator " in audited.output
    assert "[evidence-not-signed]" not in audited.output


def test_each_change_of_a_vehicles_state_is_an_entry() -> None:
    before = VehicleState(mode="GUIDED", mission_seq=1)
    after = VehicleState(mode="AUTO", mission_seq=2, landed=Landed.IN_AIR, alt_rel_m=3.0)
    assert [(what["changed"], what["from"], what["to"]) for _, what in state_changes(before, after)] == [
        ("mode", "GUIDED", "AUTO"),
        ("landed", "UNDEFINED", "IN_AIR"),
        ("mission_seq", 1, 2),
    ]
    assert state_changes(after, after) == []


def test_an_operators_request_and_its_answer_are_one_entry() -> None:
    refused = ev.Answer(3, VehicleAnswer(1, "uav1", "refused", note="[launch-without-link]"))
    ((kind, what),) = event_entries(ev.OperatorCommand(ev.FlightOrder.LAUNCH, 3), [refused])
    assert (kind, what) == (
        "operator",
        {"asks": "launch", "outcome": "refused", "note": "[launch-without-link]"},
    )
    weights = ev.WeightsChanged(4, 0.2, FiringStrength(0.7, 0.3, 0.1))
    ((_, what),) = event_entries(weights, [])
    assert what == {"asks": "weights", "w": 0.2, "firing_strength": (0.7, 0.3, 0.1)}


def test_an_order_from_the_vehicles_own_process_is_recorded_as_a_decision() -> None:
    entries = event_entries(ev.OperatorCommand(ev.FlightOrder.HOLD), [ev.Command(ev.FlightOrder.HOLD)])
    assert entries == [("note", {"decided": "hold"})]
