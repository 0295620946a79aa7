"""The simulator's documentation: its examples run, its lists are complete."""

import dataclasses
import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest
from pydantic import BaseModel

from sim_vehicle.faults import FAULTS
from sim_vehicle.scenarios import Area, Gps, Scenario, VehicleSpec, Wind
from sim_vehicle.scenarios.checks import CHECKS, COMMON
from sim_vehicle.scenarios.file import Home, Shorthand, parse_scenario
from sim_vehicle.scenarios.plan import Circle, FenceShape, Jump, Land, Leg, Loiter, RawItem, Takeoff, Waypoint
from sim_vehicle.scenarios.runner import Run
from sim_vehicle.scenarios.steps import GoTo, RawCommand, ScriptStep
from sim_vehicle.testing.rig import Clock, Vehicle, VehicleTruth, scenario_for
from sim_vehicle.testing.served import ServedFleet

ROOT = Path(__file__).parents[2]


def page(name: str) -> str:
    return (ROOT / "docs" / "simulator" / f"{name}.md").read_text(encoding="utf-8")


def blocks(language: str, name: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", page(name), flags=re.DOTALL)


def test_every_fault_is_in_the_table() -> None:
    assert re.findall(r"^\| `(\w+)` \|", page("faults"), flags=re.MULTILINE) == list(FAULTS)


def named(text: str) -> set[str]:
    """Return the words in code on a page."""
    spans = re.findall(r"`([^`\n]+)`", re.sub(r"```.*?```", "", text, flags=re.DOTALL))
    return set(re.findall(r"\w+", " ".join(spans)))


@pytest.mark.full
@pytest.mark.interop
def test_the_pytest_examples_pass_in_a_separate_project(tmp_path: Path) -> None:
    (tmp_path / "test_mine.py").write_text("\n\n".join(blocks("python", "testing")), encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)
    assert "6 passed" in done.stdout, done.stdout


@pytest.mark.virtual
@pytest.mark.parametrize(
    "text",
    [
        pytest.param(text, id=name, marks=() if name == "first" else pytest.mark.full)
        for name, text in zip(("first", "second"), blocks("yaml", "scenarios"), strict=True)
    ],
)
def test_the_scenarios_on_the_page_pass(text: str) -> None:
    lines: list[str] = []
    scenario = parse_scenario(text, "page.yaml", standalone=True)
    assert Run(scenario, on_failure=lines.append).run().passed, lines


@pytest.mark.full
@pytest.mark.virtual
def test_a_check_of_the_first_scenario_detects_its_fault() -> None:
    scenario = parse_scenario(blocks("yaml", "scenarios")[0], "page.yaml").model_copy(update={"faults": ()})
    assert not Run(scenario).run().passed


def test_every_check_is_on_the_page_with_its_summary() -> None:
    rows = re.findall(r"^\| `(\w+)` \| (.*?) \| (always|eventually|end) \| (.*) \|$", page("scenarios"), re.M)
    assert [(name, when, summary.replace("\\|", "|")) for name, _, when, summary in rows] == [
        (check.name, check.when, check.summary) for check in CHECKS.values()
    ]
    assert [argument.split(" ")[0].strip("`") for _, argument, *_ in rows] == [
        check.argument or "" for check in CHECKS.values()
    ]


@pytest.mark.parametrize(
    "model",
    [Scenario, VehicleSpec, Area, Wind, Gps, Home, Shorthand, Leg, Waypoint, Takeoff, Loiter, Land, Jump,
     RawItem, FenceShape, Circle, ScriptStep, GoTo, RawCommand],
    ids=lambda model: model.__name__,
)  # fmt: skip
def test_every_key_of_a_scenario_is_on_its_page(model: type[BaseModel]) -> None:
    known = named(page("scenarios")) | {"param2", "param3"}  # `param1` to `param4`
    assert not set(model.model_fields) - known


def test_every_setting_of_a_check_is_on_the_page() -> None:
    assert not set(COMMON) - named(page("scenarios"))


@pytest.mark.parametrize(("fixture", "kind"), [("vehicle", Vehicle), ("clock", Clock), ("link", ServedFleet)])
def test_every_fixture_attribute_is_on_the_page_and_has_its_help(fixture: str, kind: type) -> None:
    public = [name for name in vars(kind) if not name.startswith("_")]
    on_the_page = set(re.findall(rf"`{fixture}\.(\w+)", page("testing")))
    assert set(public) - on_the_page == set()
    assert [name for name in public if not inspect.getdoc(getattr(kind, name))] == []


def test_every_argument_and_field_of_the_fixtures_is_on_the_page() -> None:
    words = named(page("testing"))
    keywords = set(inspect.signature(scenario_for).parameters) - {"seed"}
    truth = {field.name for field in dataclasses.fields(VehicleTruth)}
    assert keywords | truth | {"ready_s", "sysid", "index", "sim_seed"} <= words
    assert set(ScriptStep.choices()) - {"heartbeat"} <= words


def test_the_readme_links_to_pages_that_exist() -> None:
    folder = ROOT / "sim_vehicle"
    targets = re.findall(r"\]\(([^)#]*)", (folder / "README.md").read_text(encoding="utf-8"))
    assert targets
    assert [target for target in targets if not (folder / target).exists()] == []
