"""Output and exit codes of the command line."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from profiles import examples
from recorded import of_another_format, rewrite
from swarmctl_process import SHIPPED, CliFlight, swarmctl

from swarmctl.agent.formation.approaches import APPROACHES

REAL = """\
area: {origin_lat_deg: 46.0, origin_lon_deg: 14.0, rows: 8, cols: 8, cell_size_m: 50}
threats: {count: 5}
vehicles:
  - {name: alpha, url: "udpin://:PORT", sysid: 1, start: {lat_deg: 46.0, lon_deg: 13.99}, goal: [3, 7]}
  - {name: beta, url: "udpin://:PORT", sysid: 2, start: {lat_deg: 46.001, lon_deg: 13.99}, goal: [4, 7]}
"""


@pytest.fixture
def real(tmp_path: Path) -> Path:
    file = tmp_path / "real.yaml"
    file.write_text(REAL.replace("PORT", "14999"))
    return file


def test_the_version_is_printed() -> None:
    result = swarmctl("--version")
    assert result.exit_code == 0
    assert re.fullmatch(r"swarmctl \S+\n", result.output)


def test_help_names_every_command_and_the_first_step() -> None:
    result = swarmctl("--help")
    assert result.exit_code == 0
    for word in ("fly", "plan", "check", "replay", "schema", "--example swarm"):
        assert word in result.output


def test_an_invalid_configuration_is_refused_with_every_line(tmp_path: Path) -> None:
    file = tmp_path / "bad.yaml"
    file.write_text(SHIPPED.read_text().replace("rows: 20", "rows: 0").replace("w: 0.5", "w: 2"))
    for command in ("check", "plan", "fly"):
        result = swarmctl(command, "--config", file)
        assert result.exit_code == 2
        lines = result.stderr.splitlines()
        assert [line.split(": ")[1] for line in lines] == ["area.rows", "planner.w"]
        assert all(re.match(rf"{re.escape(str(file))}:\d+: ", line) for line in lines)


def test_a_missing_configuration_is_named() -> None:
    result = swarmctl("fly", "--config", "nowhere.yaml")
    assert result.exit_code == 2
    assert result.stderr.startswith("nowhere.yaml: ")


def test_plan_shows_three_weights_and_leaves_missions_and_a_map(tmp_path: Path) -> None:
    result = swarmctl("plan", "--config", SHIPPED, "--out", tmp_path)
    assert result.exit_code == 0
    (folder,) = tmp_path.iterdir()
    assert sorted(p.name for p in folder.iterdir()) == ["map.png", *(f"uav{n}.plan" for n in range(1, 6))]
    rows = [
        line.split()
        for line in result.output.splitlines()
        if re.match(r"\s*(uav\d)?\s+(0|0\.5|1)\s+\d", line)
    ]
    assert len(rows) == 15
    for shortest, _, safest in zip(rows[0::3], rows[1::3], rows[2::3], strict=True):
        length, exposure = -5, -4
        assert float(shortest[length]) <= float(safest[length])
        assert float(shortest[exposure]) >= float(safest[exposure])
    assert json.loads((folder / "uav3.plan").read_text())["mission"]["items"][0]["command"] == 22


def test_the_schema_has_the_sections() -> None:
    result = swarmctl("schema")
    assert result.exit_code == 0
    schema = json.loads(result.output)
    assert set(schema["properties"]) >= {
        "area",
        "threats",
        "planner",
        "communication",
        "simulate",
        "vehicles",
    }
    assert schema["additionalProperties"] is False
    options = schema["$defs"]["FormationSection"]["properties"]["options"]["anyOf"]
    assert {params["title"]: set(params["properties"]) for params in options} == {
        name: set(module.Params.model_fields) for name, module in APPROACHES.items()
    }


def test_a_record_replays_with_equal_decisions_and_a_changed_record_does_not(
    small_flight: CliFlight, tmp_path: Path
) -> None:
    same = swarmctl("replay", small_flight.run)
    assert same.exit_code == 0
    changed = tmp_path / "changed.mcap"
    forget(small_flight.run / "run.mcap", changed, vehicle="uav2", event="Observed")
    differs = swarmctl("replay", changed)
    assert differs.exit_code == 1
    assert "uav2" in differs.stderr


def test_the_record_of_a_killed_process_replays_up_to_its_end(
    small_flight: CliFlight, tmp_path: Path
) -> None:
    whole = swarmctl("replay", small_flight.run)
    n_events = int(whole.output.split("are the same: ")[1].split()[0])
    content = (small_flight.run / "run.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    n_whole = []
    for share in (0.35, 0.6, 0.85):
        cut.write_bytes(content[: int(share * len(content))])
        result = swarmctl("replay", cut)
        assert result.exit_code == 0, result.output
        assert "[record-cut]" in result.output
        n_whole.append(int(result.output.split("are the same: ")[1].split()[0]))
    assert 0 < n_whole[0] < n_whole[1] <= n_whole[2] <= n_events


def test_a_record_with_a_changed_byte_replays_or_is_reported_as_damaged(
    small_flight: CliFlight, tmp_path: Path
) -> None:
    content = (small_flight.run / "run.mcap").read_bytes()
    changed = tmp_path / "changed.mcap"
    for at in range(20, len(content), len(content) // examples(100)):
        changed.write_bytes(content[:at] + bytes([content[at] ^ 0x55]) + content[at + 1 :])
        result = swarmctl("replay", changed)
        assert result.exit_code in (0, 1, 2), (at, result.exception)
        assert isinstance(result.exception, SystemExit | None), (at, result.exception)


def forget(record: Path, copy: Path, *, vehicle: str, event: str) -> None:
    """Copy a record without a vehicle's first event of a kind."""
    forgotten = False

    def change(topic: str, content: dict[str, Any]) -> bool:
        nonlocal forgotten
        is_it = topic == "/events" and (content["vehicle"], content["event"]["type"]) == (vehicle, event)
        kept = forgotten or not is_it
        forgotten |= is_it
        return kept

    rewrite(record, copy, change)


@pytest.mark.parametrize("words", [["replay"], ["dashboard"], ["plan", "--config", SHIPPED, "--known"]])
def test_a_record_of_another_format_is_refused(
    words: list[str | Path], small_flight: CliFlight, tmp_path: Path
) -> None:
    of_another_format(small_flight.run / "run.mcap", tmp_path / "run.mcap")
    result = swarmctl(*words, tmp_path)
    assert result.exit_code == 2
    assert "[other-format]" in result.stderr


TAKING_A_RUN: list[list[str | Path]] = [
    ["replay"], ["audit"], ["dashboard"], ["dashboard", "--live"], ["fly", "--resume"],
    ["plan", "--config", SHIPPED, "--known"], ["agent", "--config", SHIPPED, "--uav", "1", "--resume"],
]  # fmt: skip


@pytest.mark.parametrize("words", TAKING_A_RUN, ids=lambda words: " ".join(map(str, words[::3])))
def test_every_command_reports_a_missing_run_alike(words: list[str | Path], tmp_path: Path) -> None:
    result = swarmctl(*words, tmp_path / "nowhere")
    assert result.exit_code == 2
    assert f"{tmp_path / 'nowhere'}: not found" in result.stderr
    assert "[no-run]" in result.stderr


@pytest.mark.parametrize("content", [None, b"", b"not a record"], ids=["missing", "empty", "garbage"])
def test_an_invalid_record_is_an_error(content: bytes | None, tmp_path: Path) -> None:
    if content is not None:
        (tmp_path / "run.mcap").write_bytes(content)
    result = swarmctl("replay", tmp_path)
    assert result.exit_code == 2
    assert "run.mcap" in result.stderr


def test_fly_on_the_virtual_clock_prints_the_results(small_flight: CliFlight) -> None:
    assert "2 of 2 arrived" in small_flight.output
    assert {p.name for p in small_flight.run.iterdir()} == {
        "summary.json", "run.mcap", "foxglove.json", "evidence.jsonl", "map.png",
        "uav1.tlog", "uav2.tlog", "uav1.plan", "uav2.plan",
    }  # fmt: skip


REFUSED = [
    ("no names and no terminal", ["--real"], "--confirm alpha,beta"),
    ("one of two names", ["--real", "--confirm", "alpha"], "[not-confirmed]"),
    ("a wrong name", ["--real", "--confirm", "alpha,gamma"], "alpha,gamma;"),
]


@pytest.mark.parametrize(("words", "error"), [r[1:] for r in REFUSED], ids=[r[0] for r in REFUSED])
def test_real_vehicles_need_their_names_typed(
    words: list[str], error: str, real: Path, tmp_path: Path
) -> None:
    result = swarmctl("fly", "--config", real, "--out", tmp_path / "runs", *words)
    assert result.exit_code == 2
    assert error in result.stderr
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    "words", [["--waive", "gps,nosuch"], ["--waive", "gps", "--waive", "nosuch"]], ids=["commas", "repeated"]
)
def test_several_items_are_typed_with_commas_or_by_repeating_the_option(
    words: list[str], tmp_path: Path
) -> None:
    result = swarmctl("preflight", "--example", "swarm", "--clock", "virtual", *words)
    assert result.exit_code == 2
    assert "--waive nosuch: " in result.stderr


def test_vehicles_with_a_url_do_not_fly_on_the_virtual_clock(real: Path, tmp_path: Path) -> None:
    result = swarmctl("fly", "--config", real, "--clock", "virtual", "--out", tmp_path / "runs")
    assert result.exit_code == 2
