"""The checks by name.

A check is a function of a `VehicleUnderTest`. Its name ends the name of the check, and its docstring is the
verified statement. The function returns a measured value as text, or nothing if the statement says it all.
It raises `CheckFailed` if the vehicle behaves wrongly, and `Skip` if the check does not apply. Checks of one
shape are the rows of `checks`.
"""

import fnmatch
import importlib
import pkgutil
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from typing import Any

from sim_vehicle.conformance.guard import ARM, CRASH, PERMISSIONS
from sim_vehicle.conformance.vehicle import VehicleUnderTest

CheckFunction = Callable[[VehicleUnderTest], str | None]
Row = tuple[str, str, tuple[Any, ...], dict[str, Any]]
KNOWN = ("ardupilot", "px4")  # dialects of the autopilots with known behaviour

# In the order of the run; checks that could disturb other checks come late.
CATEGORIES = (
    "heartbeat", "version", "messages", "parameters", "commands", "modes", "home", "time", "telemetry",
    "mission", "fence", "rally", "ftp", "component", "robustness", "arming", "flight", "mission-flight",
    "logs", "signing", "reboot", "endurance",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Check:
    name: str
    function: CheckFunction
    summary: str = ""  # the verified statement in one line
    needs: frozenset[str] = frozenset()  # required permissions (`PERMISSIONS`)
    claims: Collection[str] = ()  # required MAV_PROTOCOL_CAPABILITY bits, without their prefix
    dialects: Collection[str] = ()  # names of the autopilots' dialects; empty: all
    kind: str | None = None  # copter or plane; None: both
    airborne: bool = False  # True: the check starts in flight
    # Document of the expected behaviour: MAVLink, a line of notes/AUTOPILOTS.md, or a file of a firmware.
    source: str = "MAVLink"

    @property
    def category(self) -> str:
        return self.name.partition(".")[0]

    @property
    def dangerous(self) -> bool:
        """Return True for a check that ended a known firmware; it needs an option and runs last."""
        return CRASH in self.needs


CHECKS: dict[str, Check] = {}


def _register(
    name: str, function: CheckFunction, statement: str, *,
    needs: Iterable[str] = (), airborne: bool = False, **conditions: Any,
) -> None:  # fmt: skip
    """Add a check; raise ValueError for a bad name or permission."""
    required = frozenset(needs) | ({ARM} if airborne else frozenset())
    if name in CHECKS:
        raise ValueError(f"two checks are named {name!r}")
    if name.partition(".")[0] not in CATEGORIES:
        raise ValueError(
            f"check {name!r}: a name is CATEGORY.NAME; the categories are {', '.join(CATEGORIES)}"
        )
    if unknown := required - PERMISSIONS:
        raise ValueError(f"check {name!r} needs {sorted(unknown)}; the permissions are {sorted(PERMISSIONS)}")
    CHECKS[name] = Check(name, function, statement, required, airborne=airborne, **conditions)


def check(prefix: str, **conditions: Any) -> Callable[[CheckFunction], CheckFunction]:
    """Register a function as the check `prefix.function`; prefix: category and group, as `mission.upload`.

    A final `_` of the function's name is left out. conditions: fields of `Check`.
    """

    def register(function: CheckFunction) -> CheckFunction:
        statement = (function.__doc__ or "").strip().partition("\n")[0]
        _register(f"{prefix}.{function.__name__.rstrip('_')}", function, statement, **conditions)
        return function

    return register


def row(name: str, statement: str, *arguments: Any, **conditions: Any) -> Row:
    """Return one check of a table; arguments: of the common function; conditions: fields of `Check`."""
    return name, statement, arguments, conditions


def checks(prefix: str, function: Callable[..., str | None], *rows: Row, **conditions: Any) -> None:
    """Register a check for each row; the beginning of the name, the function and `conditions` are common."""
    for name, statement, arguments, own_conditions in rows:

        def checked(vehicle: VehicleUnderTest, arguments: tuple[Any, ...] = arguments) -> str | None:
            return function(vehicle, *arguments)

        _register(f"{prefix}.{name}", checked, statement, **conditions, **own_conditions)


def all_checks() -> list[Check]:
    """Return every check of `checks/`, in the order of the run."""
    package = importlib.import_module("sim_vehicle.conformance.checks")
    for module in pkgutil.iter_modules(package.__path__):
        importlib.import_module(f"{package.__name__}.{module.name}")
    return sorted(CHECKS.values(), key=lambda found: (found.dangerous, CATEGORIES.index(found.category)))


def select(patterns: Iterable[str]) -> list[Check]:
    """Return the checks that match any of the patterns (`mission.*`, `fence`); without patterns, all checks.

    Raises ValueError if no check matches.
    """
    cleaned = [pattern.strip() for pattern in patterns if pattern.strip()]
    chosen = [
        found
        for found in all_checks()
        if not cleaned
        or any(found.name.startswith(f"{p}.") or fnmatch.fnmatchcase(found.name, p) for p in cleaned)
    ]
    if not chosen:
        raise ValueError(
            f"no check matches {', '.join(cleaned)!r}; expected a category ({', '.join(CATEGORIES)}), "
            "a name or a pattern like 'mission.*'; --list shows all checks"
        )
    return chosen
