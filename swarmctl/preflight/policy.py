"""Which parameters of which firmware say what a configuration's policy declares. Pure.

Names, values and bits by the parameter lists of ArduCopter and ArduPlane 4.5 to 4.7
(https://ardupilot.org/copter/docs/parameters.html, https://ardupilot.org/plane/docs/parameters.html) and of
PX4 1.14 to 1.16 (https://docs.px4.io/main/en/advanced_config/parameter_reference). Who flies a firmware that
no table is for does not know what it does when its link is lost.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from swarmctl.config_preflight import Policy
from swarmctl.mavlink.firmware import Firmware
from swarmctl.mavlink.parameters import equal

Version = tuple[int, int]


class NoTable(Exception):
    """Nobody knows which parameters of this firmware say what is declared, or none can."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """What one parameter may be: one of `values`, from `least` to `most`, or without the bit number `bit`."""

    name: str
    declared: str
    """what it stands for"""
    set_to: float | None = None
    """what is written where it is another, the bit aside; None: a person sets it"""
    values: tuple[float, ...] = ()
    least: float = math.nan
    most: float = math.nan
    bit: int | None = None

    def accepts(self, value: float) -> bool:
        if self.bit is not None:
            return value.is_integer() and not int(value) >> self.bit & 1
        return any(equal(value, v) for v in self.values) or self.least <= value <= self.most

    def corrected(self, value: float) -> float | None:
        """What to write in the place of `value`, which is not accepted; None: nothing."""
        return float(int(value) & ~(1 << self.bit)) if self.bit is not None else self.set_to

    def __str__(self) -> str:
        if self.bit is not None:
            return f"without bit {self.bit}"
        if self.values:
            return " or ".join(f"{v:g}" for v in self.values)
        return "above 0" if math.isinf(self.most) else f"{self.least:g} to {self.most:g}"


@dataclass(frozen=True, slots=True)
class Intent:
    """What the parameters of one vehicle are to say."""

    policy: Policy
    gcs_sysid: int
    """whose heartbeats it is to listen for"""
    altitude_m: float
    """it flies at, above home"""
    ceiling_m: float
    """above home"""

    @property
    def lost_link(self) -> str:
        return f"policy.lost_link: {self.policy.lost_link}"

    @property
    def lost_link_after(self) -> str:
        return f"policy.lost_link_after_s: {self.policy.lost_link_after_s}"

    @property
    def low_battery(self) -> str:
        return f"policy.low_battery: {self.policy.low_battery}"

    @property
    def fence_breach(self) -> str:
        return f"policy.fence_breach: {self.policy.fence_breach}"

    @property
    def fence(self) -> str:
        return f"a fence up to {self.ceiling_m:g} m"


def parameters_for(firmware: Firmware, intent: Intent) -> tuple[Wanted, ...]:
    """Raises NoTable."""
    since, table = _TABLES.get(firmware.name, ((math.inf, 0), None))
    if table is None or firmware.version < since:
        known = ", ".join(f"{name} {v[0]}.{v[1]}" for name, (v, _) in _TABLES.items())
        raise NoTable(f"no table for {firmware}; there is one from {known} on")
    return table(intent, firmware.version)


def _one(name: str, declared: str, values: Mapping[str, tuple[float, ...]], action: str) -> Wanted:
    """An action by its numbers, of which the first is written."""
    if action not in values:
        raise NoTable(f"{name} has no value for {declared}; it can {', '.join(values)}")
    return Wanted(name, declared, values[action][0], values[action])


def _exactly(name: str, declared: str, value: float) -> Wanted:
    return Wanted(name, declared, value, (value,))


def _above_zero(name: str, declared: str) -> Wanted:
    return Wanted(name, declared, least=1e-6, most=math.inf)


def _ceiling(name: str, intent: Intent) -> Wanted:
    """High enough for the flight, and no higher than declared."""
    return Wanted(name, intent.fence, intent.ceiling_m, least=intent.altitude_m, most=intent.ceiling_m)


def _ardupilot_gcs(version: Version) -> str:
    return "MAV_GCS_SYSID" if version >= (4, 7) else "SYSID_MYGCS"


# 1 and 3, 2 and 3: also by the way it came (SmartRTL).
_COPTER_LOST_LINK = {"return": (1.0, 3.0), "land": (5.0,), "hold": (7.0,), "continue": (0.0,)}
_COPTER_BATTERY = {"return": (2.0, 3.0), "land": (1.0,)}
_COPTER_FENCE = {"return": (1.0, 3.0), "land": (2.0,), "hold": (4.0,)}
_GOES_ON_IN_AUTO = 1  # bit of FS_OPTIONS
_HEIGHT_AND_POLYGON = 5.0  # FENCE_TYPE; not the circle around home, which is nowhere declared


def _copter(intent: Intent, version: Version) -> tuple[Wanted, ...]:
    policy = intent.policy
    return (
        _one("FS_GCS_ENABLE", intent.lost_link, _COPTER_LOST_LINK, policy.lost_link),
        *(
            (
                _exactly("FS_GCS_TIMEOUT", intent.lost_link_after, policy.lost_link_after_s),
                Wanted("FS_OPTIONS", intent.lost_link, bit=_GOES_ON_IN_AUTO),
                _exactly(_ardupilot_gcs(version), intent.lost_link, intent.gcs_sysid),
            )
            if policy.lost_link != "continue"
            else ()
        ),
        _one("BATT_FS_LOW_ACT", intent.low_battery, _COPTER_BATTERY, policy.low_battery),
        *_ardupilot_battery(intent),
        *_ardupilot_fence(intent),
        _one("FENCE_ACTION", intent.fence_breach, _COPTER_FENCE, policy.fence_breach),
    )


def _plane(intent: Intent, version: Version) -> tuple[Wanted, ...]:
    policy = intent.policy
    watched = policy.lost_link != "continue"
    return (
        _exactly("FS_GCS_ENABL", intent.lost_link, 1.0 if watched else 0.0),
        *(
            (
                _one("FS_LONG_ACTN", intent.lost_link, {"return": (1.0,)}, policy.lost_link),
                _exactly("FS_LONG_TIMEOUT", intent.lost_link_after, policy.lost_link_after_s),
                _exactly(_ardupilot_gcs(version), intent.lost_link, intent.gcs_sysid),
            )
            if watched
            else ()
        ),
        _one("BATT_FS_LOW_ACT", intent.low_battery, {"return": (1.0,), "land": (2.0,)}, policy.low_battery),
        *_ardupilot_battery(intent),
        *_ardupilot_fence(intent),
        _one("FENCE_ACTION", intent.fence_breach, {"return": (1.0,)}, policy.fence_breach),
    )


def _ardupilot_battery(intent: Intent) -> tuple[Wanted, ...]:
    """There is a monitor, and a voltage that counts as low: both depend on what is built in."""
    return _above_zero("BATT_MONITOR", intent.low_battery), _above_zero("BATT_LOW_VOLT", intent.low_battery)


def _ardupilot_fence(intent: Intent) -> tuple[Wanted, ...]:
    return (
        _exactly("FENCE_ENABLE", intent.fence, 1.0),
        _exactly("FENCE_TYPE", intent.fence, _HEIGHT_AND_POLYGON),
        _ceiling("FENCE_ALT_MAX", intent),
    )


_PX4_LOST_LINK = {"return": (2.0,), "land": (3.0,), "hold": (1.0,), "continue": (0.0,)}
_PX4_BATTERY = {"return": (3.0,), "land": (2.0,)}
_PX4_FENCE = {"return": (3.0,), "land": (5.0,), "hold": (2.0,)}
_PX4_MISSION_EXCEPTED = 0  # bit of COM_DLL_EXCEPT


def _px4(intent: Intent, version: Version) -> tuple[Wanted, ...]:
    policy = intent.policy
    watched = policy.lost_link != "continue"
    return (
        _one("NAV_DLL_ACT", intent.lost_link, _PX4_LOST_LINK, policy.lost_link),
        *((_exactly("COM_DL_LOSS_T", intent.lost_link_after, policy.lost_link_after_s),) if watched else ()),
        *(
            (Wanted("COM_DLL_EXCEPT", intent.lost_link, bit=_PX4_MISSION_EXCEPTED),)
            if watched and version >= (1, 16)
            else ()
        ),
        _one("COM_LOW_BAT_ACT", intent.low_battery, _PX4_BATTERY, policy.low_battery),
        _one("GF_ACTION", intent.fence_breach, _PX4_FENCE, policy.fence_breach),
        _ceiling("GF_MAX_VER_DIST", intent),
        _exactly("GF_MAX_HOR_DIST", intent.fence, 0.0),
    )


_TABLES: Mapping[str, tuple[Version, Callable[[Intent, Version], tuple[Wanted, ...]]]] = {
    "ArduCopter": ((4, 5), _copter),
    "ArduPlane": ((4, 5), _plane),
    "PX4": ((1, 14), _px4),
}
