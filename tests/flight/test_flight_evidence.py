"""The evidence of whole flights, compared with the messages on the wire."""

from __future__ import annotations

import asyncio
import datetime as dt
import hashlib
import json
from pathlib import Path

import pytest
from evidence_files import sent_to
from flights import STATION, fly, small
from typer.testing import CliRunner, Result

from swarmctl.bus import keys
from swarmctl.bus.transports.memory import MemoryBus
from swarmctl.cli.main import cli
from swarmctl.core.messages import SetWeights
from swarmctl.core.records import replace
from swarmctl.flight.run import DEFAULT_OPTIONS
from swarmctl.preflight.waivers import parse_waivers
from swarmctl.report.evidence.chain import CheckedChain, check
from swarmctl.report.evidence.digest import digest
from swarmctl.report.evidence.log import FILE_NAME
from swarmctl.security.issue import make_keys
from swarmctl.station import commands


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flown")
    assert fly(small(), folder).all_arrived
    return folder


def evidence(folder: Path) -> CheckedChain:
    with (folder / FILE_NAME).open("rb") as file:
        return check(file)


@pytest.mark.virtual
def test_the_evidence_of_a_flight_is_whole_names_the_run_and_covers_its_files(flown: Path) -> None:
    checked = evidence(flown)
    assert checked.fault == ""
    assert checked.closing is not None
    files = ("run.mcap", "uav1.tlog", "uav2.tlog", "uav3.tlog")
    assert checked.closing.files == {
        name: hashlib.sha256((flown / name).read_bytes()).hexdigest() for name in files
    }
    assert checked.opened.run == "small"
    assert checked.opened.vehicles == {"uav1": 1, "uav2": 2, "uav3": 3}
    assert len(checked.opened.configuration_sha256) == 64


@pytest.mark.virtual
def test_every_command_on_the_wire_is_in_the_evidence_in_its_order(flown: Path) -> None:
    entries = evidence(flown).entries
    for name in ("uav1", "uav2", "uav3"):
        recorded = [e.what for e in entries if e.vehicle == name and e.kind == "command"]
        sent = sent_to(flown / f"{name}.tlog")
        fields = ("param1", "param2", "param_id", "seq", "x", "y", "count", "start_index")
        assert [(what["message"], *(what[key] for key in fields if key in what)) for what in recorded] == [
            (m.get_type(), *(getattr(m, key) for key in fields if hasattr(m, key))) for m in sent
        ]
        assert {m.get_type() for m in sent} >= {"COMMAND_LONG", "MISSION_COUNT", "MISSION_ITEM_INT"}


@pytest.mark.virtual
def test_the_digest_shows_answers_and_effects_of_a_flight(flown: Path) -> None:
    checked = evidence(flown)
    digests = digest(
        checked, {name: (flown / f"{name}.tlog").read_bytes() for name in checked.opened.vehicles}
    )
    for found in digests.values():
        arming, uploads = found.rows["COMPONENT_ARM_DISARM"], found.rows["MISSION_COUNT"]
        assert (arming.sent, arming.answers, arming.effects) == (1, {"ACCEPTED": 1}, {"True": 1})
        assert uploads.answers == {"ACCEPTED": uploads.sent}
        assert sum(row.unanswered for row in found.rows.values()) == 0
        assert found.rows["MISSION_START"].effects == {"AUTO": 1}
        assert (found.unasked, found.n_disarmed_on_ground) == ({}, 1)
    assert any("DO_SET_MISSION_CURRENT" in found.rows for found in digests.values())


@pytest.mark.full
@pytest.mark.virtual
def test_operators_actions_are_in_the_evidence(tmp_path: Path) -> None:
    scenario = small(sensor={"source": "external"})
    report = json.dumps({"version": 1, "cells": [[0, 0, False]], "source": "operator"}).encode()
    by_camera = json.dumps({"version": 1, "cells": [[0, 1, False]], "source": "camera"}).encode()
    options = replace(DEFAULT_OPTIONS, waivers=parse_waivers(["battery:uav1"], {1: "uav1"}))
    bus = MemoryBus()

    async def operate() -> None:
        await asyncio.sleep(30.0)
        await commands.ask(bus, STATION, SetWeights((1,), w=1.0))
        for data in (report, by_camera):
            await bus.ask(keys.sensor_report("small", 2), data, 5.0)

    fly(scenario, tmp_path, bus=bus, options=options, beside=operate)
    entries = evidence(tmp_path).entries
    asked = [(e.vehicle, e.what["asks"]) for e in entries if e.kind == "operator"]
    assert asked == [("uav1", "weights"), ("uav2", "observe")]
    # No check failed, so no waiver was used.
    assert not [e for e in entries if e.kind == "waiver"]


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
