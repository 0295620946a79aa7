"""pytest fixtures: `vehicle`, `swarm`, `clock` and `link`. Heavy imports run on first use.

The seed of a test comes from the names of the test and its file, or from `--sim-seed`. A failing test prints
the seed, the command that repeats the test, and the folder with the tlogs of the vehicles.
"""

import os
import shlex
import sys
import zlib
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from sim_vehicle.scenarios import Scenario
    from sim_vehicle.testing.rig import Clock, Rig, Swarm, Vehicle
    from sim_vehicle.testing.served import ServedFleet

RIG = pytest.StashKey["Rig"]()
CREATE_FOLDER = pytest.StashKey[Callable[[], Path]]()  # creates the folder of a failing test's tlogs


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("sim_vehicle", "simulated vehicles")
    group.addoption(
        "--sim-seed",
        type=int,
        default=None,
        metavar="N",
        help="seed of the simulated vehicles; default: a seed from the names of each test and its file",
    )


@pytest.fixture
def sim_seed(request: pytest.FixtureRequest) -> int:
    """Return the seed of this test's vehicles: `--sim-seed`, or a seed from the names of test and file."""
    given: int | None = request.config.getoption("--sim-seed")
    if given is not None:
        return given
    # The folder is left out, because it depends on the machine and on pytest's root.
    name = "::".join([request.node.path.name, *request.node.nodeid.split("::")[1:]])
    return zlib.crc32(name.encode())


@pytest.fixture
def _sim_rig(
    request: pytest.FixtureRequest, sim_seed: int, tmp_path_factory: pytest.TempPathFactory
) -> "Rig":
    from sim_vehicle.testing.rig import Rig  # noqa: PLC0415

    rig = Rig(sim_seed)
    request.node.stash[CREATE_FOLDER] = lambda: tmp_path_factory.mktemp("tlogs")
    request.node.stash[RIG] = rig
    return rig


@pytest.fixture
def clock(_sim_rig: "Rig") -> "Clock":
    """Return the simulated time: `run_until(condition, timeout)`, `run_for(seconds)`, `now`."""
    from sim_vehicle.testing.rig import Clock  # noqa: PLC0415

    return Clock(_sim_rig)


@pytest.fixture
def swarm(_sim_rig: "Rig") -> "Callable[..., Swarm]":
    """Return a function that creates vehicles: `swarm(count=3, personality="px4", faults=["gps_loss"])`.

    Parameters
    ----------
    count: number of vehicles.
    personality: ardupilot, px4 or mixed.
    kind: copter or plane.
    faults: as for --fault.
    ready_s: time from boot to a position [s]; None: as on the real autopilots.
    params: parameters of all vehicles.
    home: latitude [deg], longitude [deg], altitude [m].
    wind: as in a scenario.
    scenario: file or Scenario; replaces count, personality, kind and home; faults, params and wind are added.

    The function raises ScenarioError for an invalid argument, RuntimeError if the test already has a fleet.
    """
    from sim_vehicle.scenarios import ScenarioError  # noqa: PLC0415
    from sim_vehicle.testing.rig import HOME, scenario_for  # noqa: PLC0415

    def make(
        count: int = 1,
        *,
        personality: str = "ardupilot",
        kind: str = "copter",
        faults: Sequence[str] = (),
        ready_s: float | None = 0.0,
        params: Mapping[str, float] | None = None,
        home: tuple[float, float, float] = HOME,
        wind: Mapping[str, float] | None = None,
        scenario: "Scenario | Path | str | None" = None,
    ) -> "Swarm":
        __tracebackhide__ = True  # the error is in the test's own line
        try:
            built = scenario_for(
                count,
                seed=_sim_rig.seed,
                personality=personality,
                kind=kind,
                faults=faults,
                params=params,
                home=home,
                wind=wind,
                scenario=scenario,
            )
        except ScenarioError as error:
            raise ScenarioError(str(error)) from None
        return _sim_rig.create(built, ready_s)

    make.__name__ = make.__qualname__ = "swarm"  # name in Python's error message for an unknown keyword
    return make


@pytest.fixture
def vehicle(swarm: "Callable[..., Swarm]") -> "Vehicle":
    """Return one ArduPilot copter, ready to arm."""
    return swarm()[0]


@pytest.fixture
def link(_sim_rig: "Rig") -> "Iterator[ServedFleet]":
    """Serve the fleet over UDP in real time (`link.url`, `link.address`), or as `link.serve(...)` says."""
    from sim_vehicle.testing.served import ServedFleet  # noqa: PLC0415

    served = ServedFleet(_sim_rig)
    yield served
    served.close()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    rig = item.stash.get(RIG, None)
    if report.failed and rig is not None:
        lines = [_summary(rig), f"repeat with: {_command(item, rig.seed)}"]
        if rig.vehicles and (folder := _tlogs(item, rig)) is not None:
            lines.append(f"tlogs: {folder}")
        report.sections.append(("sim_vehicle", "\n".join(lines)))
    return report


def _tlogs(item: pytest.Item, rig: "Rig") -> Path | None:
    """Write a tlog of each vehicle and return the folder; None if a file cannot be written."""
    try:
        folder = item.stash[CREATE_FOLDER]()
        rig.write_tlogs(folder)
    except OSError:
        return None
    return folder


def _summary(rig: "Rig") -> str:
    """Return the seed, the number of vehicles, the simulated time and the server's last messages."""
    count = len(rig.vehicles)
    seed = f"seed {rig.seed}, {count} vehicle{'' if count == 1 else 's'}, {rig.now:.2f} s simulated"
    return "\n".join([seed, *rig.operator_lines])


def _command(item: pytest.Item, seed: int) -> str:
    """Return the command that repeats a test in the folder where pytest began."""
    installed = item.config.pluginmanager.list_plugin_distinfo()
    loads = "" if any(plugin is sys.modules[__name__] for plugin, _ in installed) else f"-p {__name__} "
    file = os.path.relpath(item.path, item.config.invocation_params.dir)
    node = "::".join([file, *item.nodeid.split("::")[1:]])
    return f"python -m pytest {loads}{shlex.quote(node)} --sim-seed {seed}"
