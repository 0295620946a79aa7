"""The simulator's documentation: its examples run, its lists are complete."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from sim_vehicle.faults import FAULTS
from sim_vehicle.scenarios.checks import CHECKS
from sim_vehicle.scenarios.file import parse_scenario
from sim_vehicle.scenarios.runner import Run

ROOT = Path(__file__).parents[2]


def page(name: str) -> str:
    return (ROOT / "docs" / "simulator" / f"{name}.md").read_text(encoding="utf-8")


def blocks(language: str, name: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", page(name), flags=re.DOTALL)


def test_every_fault_is_in_the_table() -> None:
    assert re.findall(r"^\| `(\w+)` \|", page("faults"), flags=re.MULTILINE) == list(FAULTS)


@pytest.mark.interop
def test_the_pytest_examples_pass_in_a_separate_project(tmp_path: Path) -> None:
    (tmp_path / "test_mine.py").write_text("\n\n".join(blocks("python", "testing")), encoding="utf-8")
    plugins = ["-p", "no:cacheprovider", "-p", "sim_vehicle.pytest_plugin"]
    command = [sys.executable, "-m", "pytest", "-q", *plugins]
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


def test_the_readme_links_to_pages_that_exist() -> None:
    folder = ROOT / "sim_vehicle"
    targets = re.findall(r"\]\(([^)#]*)", (folder / "README.md").read_text(encoding="utf-8"))
    assert targets
    assert [target for target in targets if not (folder / target).exists()] == []
