"""The pytest plug-in in a separate pytest: output of failing tests, and their repetition."""

import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from pymavlink import mavutil

pytestmark = pytest.mark.interop
ROOT = Path(__file__).parent.parent.parent
MODULE = "sim_vehicle.pytest_plugin"
DEADLINE_S = 120

FAILING = """
def test_hovers(vehicle, clock):
    clock.run_for(5)
    print("noise", vehicle.raw.hex())
    assert vehicle.height_m > 1

def test_plain():
    assert False

class TestNamed:
    def test_times(self, swarm, clock):
        swarm(count=2, personality="px4")
        clock.run_until(lambda: False, timeout=1)
"""


def run_pytest(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return run([sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *arguments], folder)


def run(command: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join([str(ROOT), str(folder / "installed")])
    environment = {**os.environ, "PYTHONPATH": path, "PYTEST_ADDOPTS": "", "COLUMNS": "200"}
    if not (folder / "installed").exists():
        # Without the other plug-ins, whose imports take most of the time.
        environment |= {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1", "PYTEST_PLUGINS": MODULE}
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=DEADLINE_S, check=False
    )


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """Return another project, which loads the plug-in like an entry point."""
    (tmp_path / "pytest.ini").write_text("[pytest]\nfilterwarnings = error\n")
    folder = tmp_path / "checks of mine"
    folder.mkdir()
    (folder / "test_mine.py").write_text(FAILING)
    return tmp_path


def test_a_failing_test_prints_its_seed_and_a_repeating_command(project: Path) -> None:
    first = run_pytest(project, "-p", MODULE)
    assert first.returncode == 1, first.stdout + first.stderr
    assert first.stdout.count("repeat with:") == 2  # not for the test without vehicles
    commands = re.findall(r"repeat with: (.*)", first.stdout)
    assert re.search(r"seed \d+, 1 vehicle, 5\.00 s simulated", first.stdout)
    assert re.search(r"seed \d+, 2 vehicles, 1\.00 s simulated", first.stdout)
    assert "TestNamed::test_times" in commands[1]
    words = shlex.split(commands[0])
    assert words[:3] == ["python", "-m", "pytest"]
    again = run([sys.executable, *words[1:]], project)
    assert again.returncode == 1
    assert again.stdout.count("repeat with:") == 1
    noise = [re.search(r"noise (\w+)", output).group(1) for output in (first.stdout, again.stdout)]  # type: ignore[union-attr]
    assert noise[0] == noise[1]


@pytest.mark.full
def test_another_seed_gives_another_flight(project: Path) -> None:
    outputs = [
        run_pytest(project, "-p", MODULE, "-k", "hovers", "--sim-seed", seed).stdout
        for seed in ("12345", "12346")
    ]
    assert "seed 12345, 1 vehicle" in outputs[0]
    noise = [re.search(r"noise (\w+)", output).group(1) for output in outputs]  # type: ignore[union-attr]
    assert noise[0] != noise[1]


@pytest.mark.full
@pytest.mark.parametrize("also_by_name", [[], ["-p", MODULE]], ids=["entry point", "entry point and -p"])
def test_an_installed_package_needs_no_option(project: Path, also_by_name: list[str]) -> None:
    distribution = project / "installed" / "another-1.0.dist-info"
    distribution.mkdir(parents=True)
    (distribution / "METADATA").write_text("Metadata-Version: 2.1\nName: another\nVersion: 1.0\n")
    entry_points = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"]["pytest11"]
    lines = [f"{name} = {module}\n" for name, module in entry_points.items()]
    (distribution / "entry_points.txt").write_text("[pytest11]\n" + "".join(lines))
    first = run_pytest(project, "-k", "hovers", *also_by_name)
    assert first.returncode == 1, first.stdout + first.stderr
    (command,) = re.findall(r"repeat with: (.*)", first.stdout)
    again = run([sys.executable, *shlex.split(command)[1:]], project)
    assert again.stdout.count("repeat with:") == 1


@pytest.mark.full
def test_the_repeating_command_works_from_the_folder_of_pytest(project: Path) -> None:
    inner = project / "checks of mine"
    first = run_pytest(inner, "-p", MODULE, "-k", "hovers")
    (command,) = re.findall(r"repeat with: (.*)", first.stdout)
    assert shlex.split(command)[-3] == "test_mine.py::test_hovers"
    again = run([sys.executable, *shlex.split(command)[1:]], inner)
    assert "1 failed" in again.stdout


@pytest.mark.full
def test_warnings_of_a_served_fleet_are_in_the_report_of_a_failing_test(project: Path) -> None:
    (project / "checks of mine" / "test_mine.py").write_text(
        "import socket\n"
        "def test_alone(vehicle, link, clock):\n"
        "    with socket.socket() as unused:\n"
        "        unused.bind(('127.0.0.1', 0))\n"
        "        link.serve(f'tcpout:127.0.0.1:{unused.getsockname()[1]}', speedup=10)\n"
        "        clock.run_for(1)\n"
        "        assert vehicle.armed\n"
    )
    done = run_pytest(project, "-p", MODULE)
    assert "1 failed" in done.stdout
    assert "error" not in done.stdout.splitlines()[-1]
    assert re.search(r"seed \d+, 1 vehicle, .* simulated\ntcpout .*\[no-server\]", done.stdout)


@pytest.mark.full
def test_the_seed_is_the_same_from_any_folder(
    project: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    (elsewhere / "test_mine.py").write_text(FAILING)
    outputs = [
        run_pytest(project, "-p", MODULE).stdout,
        run_pytest(project / "checks of mine", "-p", MODULE, "--rootdir", ".").stdout,
        run_pytest(elsewhere, "-p", MODULE).stdout,
    ]
    seeds = [re.findall(r"^seed (\d+)", output, re.MULTILINE) for output in outputs]
    assert len(set(seeds[0])) == 2  # one a test
    assert seeds[1] == seeds[2] == seeds[0]
    assert "--sim-seed=N" in " ".join(run_pytest(project, "-p", MODULE, "--help").stdout.split())


def test_a_failing_test_leaves_readable_tlogs(project: Path) -> None:
    (project / "checks of mine" / "test_mine.py").write_text(
        "def test_flies(swarm, clock):\n"
        "    first, second = swarm(count=2, personality='mixed')\n"
        "    second.do('takeoff', 5)\n"
        "    first.send(b'garbage')\n"
        "    clock.run_for(8)\n"
        "    assert second.height_m > 100\n"
        "def test_passes(vehicle, clock):\n"
        "    clock.run_for(1)\n"
    )
    done = run_pytest(project, "-p", MODULE, "--basetemp", str(project / "base"))
    (folder,) = re.findall(r"^tlogs: (.*)", done.stdout, re.MULTILINE)
    assert len(list((project / "base").glob("tlogs[0-9]*"))) == 1  # none of passing tests
    assert sorted(path.name for path in Path(folder).iterdir()) == ["vehicle-1.tlog", "vehicle-2.tlog"]
    log = mavutil.mavlink_connection(str(Path(folder) / "vehicle-2.tlog"))
    times_by_type: dict[str, list[float]] = {}
    while (message := log.recv_match()) is not None:
        if not message.get_type().startswith("UNKNOWN"):  # pymavlink's dialect lacks some messages of PX4
            assert message.get_srcSystem() in (2, 255)
        times_by_type.setdefault(message.get_type(), []).append(message._timestamp)
    log.close()
    assert "BAD_DATA" not in times_by_type
    assert {"HEARTBEAT", "COMMAND_LONG", "COMMAND_ACK", "LOCAL_POSITION_NED"} <= set(times_by_type)
    assert times_by_type["HEARTBEAT"] == sorted(times_by_type["HEARTBEAT"])
    assert times_by_type["HEARTBEAT"][-1] - times_by_type["HEARTBEAT"][0] > 6


def test_a_wrong_call_is_shown_at_the_line_of_the_test(project: Path) -> None:
    calls = ["swarm(cuont=2)", "swarm(count=0)", "swarm(personality='betaflight')", "swarm(wind={'x': 1})",
             "swarm()[0].do('land_on_the_moon')", "swarm()[0].do('takeoff')", "swarm()[0].inject('gps_los')",
             "clock.run_until(lambda: False, timeout=1)", "link.url", "swarm() and swarm()"]  # fmt: skip
    tests = [f"def test_{i}(swarm, clock, link):\n    {call}\n" for i, call in enumerate(calls)]
    (project / "checks of mine" / "test_mine.py").write_text("".join(tests))
    done = run_pytest(project, "-p", MODULE)
    assert f"{len(calls)} failed" in done.stdout
    assert re.search(r"TypeError: swarm\(\) got an unexpected keyword argument 'cuont'", done.stdout)
    assert str(ROOT) not in done.stdout  # no lines of the package
    assert "During handling of" not in done.stdout
    assert "The above exception" not in done.stdout
    assert done.stdout.count("\n") < 20 * len(calls)


def test_heavy_imports_wait_for_the_first_fixture(project: Path) -> None:
    (project / "checks of mine" / "test_mine.py").write_text(
        "import sys\n"
        "def test_light():\n"
        "    heavy = {'numpy', 'pymavlink', 'pydantic', 'scipy', 'rich', 'sim_vehicle.fleet'}\n"
        "    assert not heavy & set(sys.modules)\n"
    )
    done = run_pytest(project, "-p", MODULE)
    assert done.returncode == 0, done.stdout
