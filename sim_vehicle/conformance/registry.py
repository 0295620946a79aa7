"""The checks by name, and what a check may say.

A check is a function of a `Peer` that returns in a few words what was seen. It raises `CheckFailed` where the
vehicle is wrong and `Skip` where it does not claim what would be checked.
"""

import fnmatch
import importlib
import pkgutil
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from sim_vehicle.conformance.guard import ARM, PERMISSIONS
from sim_vehicle.conformance.peer import Peer

CheckFunction = Callable[[Peer], str]

# In the order they are run: what could disturb the rest comes late.
CATEGORIES = (
    "heartbeat", "version", "messages", "parameters", "commands", "modes", "home", "time", "telemetry",
    "mission", "fence", "rally", "ftp", "component", "robustness", "arming", "flight", "mission-flight",
    "logs", "signing", "reboot", "endurance",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Check:
    """One check.

    needs: what has to be allowed (`PERMISSIONS`). claims: MAV_PROTOCOL_CAPABILITY bits without their prefix,
    each of which the vehicle must claim. dialects: names of the dialects it applies to, empty for all; kind:
    for a plane or a copter alone. airborne: it begins in flight. pins: the statement it holds the vehicle to.
    limit_s: of vehicle time, after which it has failed.
    """

    name: str
    function: CheckFunction
    needs: frozenset[str]
    claims: tuple[str, ...]
    dialects: frozenset[str]
    kind: str | None
    airborne: bool
    pins: str
    limit_s: float

    @property
    def category(self) -> str:
        return self.name.partition(".")[0]

    @property
    def says(self) -> str:
        """What the check is about, in one line."""
        return (self.function.__doc__ or "").strip().partition("\n")[0]


CHECKS: dict[str, Check] = {}


def check(
    name: str,
    *,
    needs: Iterable[str] = (),
    claims: Iterable[str] = (),
    dialects: Iterable[str] = (),
    kind: str | None = None,
    airborne: bool = False,
    pins: str = "MAVLink",
    limit_s: float = 60.0,
) -> Callable[[CheckFunction], CheckFunction]:
    """Put a function into the registry under `category.name`."""
    wanted = frozenset(needs) | ({ARM} if airborne else set())
    if name in CHECKS:
        raise ValueError(f"two checks are named {name!r}")
    if name.partition(".")[0] not in CATEGORIES or not name.partition(".")[2]:
        raise ValueError(
            f"check {name!r}: its name is no CATEGORY.NAME; categories are {', '.join(CATEGORIES)}"
        )
    if not wanted <= PERMISSIONS:
        raise ValueError(
            f"check {name!r} needs {sorted(wanted - PERMISSIONS)}; known are {sorted(PERMISSIONS)}"
        )

    def register(function: CheckFunction) -> CheckFunction:
        CHECKS[name] = Check(
            name,
            function,
            frozenset(wanted),
            tuple(claims),
            frozenset(dialects),
            kind,
            airborne,
            pins,
            limit_s,
        )
        return function

    return register


def all_checks() -> list[Check]:
    """Every check of `checks/`, in the order they are run."""
    package = importlib.import_module("sim_vehicle.conformance.checks")
    for module in pkgutil.iter_modules(package.__path__):
        importlib.import_module(f"{package.__name__}.{module.name}")
    return sorted(CHECKS.values(), key=lambda found: CATEGORIES.index(found.category))


def select(patterns: Iterable[str]) -> list[Check]:
    """The checks whose name fits one of the patterns (all without any): `mission.*`, `*unknown*`, `fence`."""
    wanted = [pattern.strip() for pattern in patterns if pattern.strip()]
    chosen = [
        found
        for found in all_checks()
        if not wanted
        or any(found.name.startswith(f"{p}.") or fnmatch.fnmatchcase(found.name, p) for p in wanted)
    ]
    if not chosen:
        raise ValueError(
            f"no check fits {', '.join(wanted)!r}; expected a category ({', '.join(CATEGORIES)}), "
            "a name or a "
            "pattern like 'mission.*'; --list shows all"
        )
    return chosen
