"""pytest fixtures: `vehicle`, `swarm`, `clock` and `link`; nothing heavy is imported until one is used.

A test's randomness comes from its own name, or from `--sim-seed`; one that fails prints the seed and the
command that repeats it.
"""

import os
import shlex
import sys
import zlib
from collections.abc import Callable, Generator, Iterator
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from sim_vehicle.testing.rig import Clock, Rig, Swarm, Vehicle
    from sim_vehicle.testing.served import Link

RIG = pytest.StashKey["Rig"]()


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("sim_vehicle", "simulated vehicles")
    group.addoption(
        "--sim-seed",
        type=int,
        default=None,
        metavar="N",
        help="seed of the simulated vehicles, instead of one from each test's name",
    )


@pytest.fixture
def sim_seed(request: pytest.FixtureRequest) -> int:
    """The seed of this test's vehicles."""
    given: int | None = request.config.getoption("--sim-seed")
    return zlib.crc32(request.node.nodeid.encode()) if given is None else given


@pytest.fixture
def _sim_rig(request: pytest.FixtureRequest, sim_seed: int) -> "Rig":
    from sim_vehicle.testing.rig import Rig  # noqa: PLC0415

    rig = Rig(sim_seed)
    request.node.stash[RIG] = rig
    return rig


@pytest.fixture
def clock(_sim_rig: "Rig") -> "Clock":
    """Simulated time: `run_until(condition, timeout)`, `run_for(seconds)`, `now`."""
    from sim_vehicle.testing.rig import Clock  # noqa: PLC0415

    return Clock(_sim_rig)


@pytest.fixture
def swarm(_sim_rig: "Rig") -> "Callable[..., Swarm]":
    """Makes a test's vehicles: `swarm(count=3, personality="px4", faults=["packet_loss:rate=0.1"])`.

    count, personality (ardupilot, px4, mixed), kind (copter, plane), faults (as for --fault), ready_s (from
    boot to a position [s], 0 if not given; None: as long as the real ones take), params, home (latitude,
    longitude, altitude), wind (as in a scenario), or a scenario (a file or a Scenario) to begin with.
    """
    from sim_vehicle.testing.rig import scenario_for  # noqa: PLC0415

    def make(count: int = 1, *, ready_s: float | None = 0.0, **options: Any) -> "Swarm":
        return _sim_rig.create(scenario_for(count, seed=_sim_rig.seed, **options), ready_s)

    return make


@pytest.fixture
def vehicle(swarm: "Callable[..., Swarm]") -> "Vehicle":
    """One ArduPilot copter, ready to arm."""
    made: Vehicle = swarm()[0]
    return made


@pytest.fixture
def link(_sim_rig: "Rig") -> "Iterator[Link]":
    """The fleet over UDP in real time: `link.url`, `link.address`; `link.serve(speedup=10)` to be quicker."""
    from sim_vehicle.testing.served import Link  # noqa: PLC0415

    served = Link(_sim_rig)
    yield served
    served.close()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    rig = item.stash.get(RIG, None)
    if report.failed and rig is not None:
        report.sections.append(("sim_vehicle", f"{_words(rig)}\nrepeat with: {_command(item, rig.seed)}"))
    return report


def _words(rig: "Rig") -> str:
    count = len(rig.vehicles)
    return f"seed {rig.seed}, {count} vehicle{'' if count == 1 else 's'}, {rig.now:.2f} s simulated"


def _command(item: pytest.Item, seed: int) -> str:
    """From the folder pytest was started in."""
    installed = item.config.pluginmanager.list_plugin_distinfo()
    loads = "" if any(plugin is sys.modules[__name__] for plugin, _ in installed) else f"-p {__name__} "
    file = os.path.relpath(item.path, item.config.invocation_params.dir)
    node = "::".join([file, *item.nodeid.split("::")[1:]])
    return f"python -m pytest {loads}{shlex.quote(node)} --sim-seed {seed}"
