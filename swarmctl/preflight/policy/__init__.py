"""Parameters of each firmware for the behaviour that a configuration declares. Pure.

Sources of names, values and bits: the parameter lists of ArduCopter and ArduPlane 4.5 to 4.7
(https://ardupilot.org/copter/docs/parameters.html, https://ardupilot.org/plane/docs/parameters.html) and of
PX4 1.14 to 1.16 (https://docs.px4.io/main/en/advanced_config/parameter_reference). The code that reads the
parameters: ArduCopter/events.cpp, mode_rtl.cpp, ekf_check.cpp, AC_WPNav.cpp, AC_Fence.cpp,
AP_BattMonitor_Params.cpp; commander/failsafe/failsafe.cpp.
ArduPlane's RTL_ALTITUDE, AIRSPEED_CRUISE, AIRSPEED_MIN and ROLL_LIMIT_DEG have these names from 4.5 on
(before: ALT_HOLD_RTL, TRIM_ARSPD_CM, ARSPD_FBW_MIN, LIM_ROLL_CD; ArduPlane/Parameters.cpp converts them).
The behaviour of older and later versions at a lost link is unknown, so these versions have no table.

Reactions to a lost remote control are not declared. ArduCopter does not arm without a remote control unless
FS_THR_ENABLE is 0 ("RC not found"). PX4 reacts only to the loss of a remote control that was present at
arming (NAV_RCL_ACT). The end of set-points counts only for members of a formation.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from swarmctl.mavlink.firmware import Firmware
from swarmctl.preflight.policy import ardupilot, px4
from swarmctl.preflight.policy.behaviour import DeclaredBehaviour
from swarmctl.preflight.policy.required import NoParameterTable, RequiredParameter, Version

__all__ = ["DeclaredBehaviour", "NoParameterTable", "RequiredParameter", "parameters_for"]


def parameters_for(firmware: Firmware, behaviour: DeclaredBehaviour) -> tuple[RequiredParameter, ...]:
    """Return the required parameters of a vehicle. Raises NoParameterTable."""
    since, until, table = _TABLES.get(firmware.name, ((0, 0), (0, 0), None))
    if table is None or not since <= firmware.version <= until:
        known = (f"{name} {a[0]}.{a[1]} to {b[0]}.{b[1]}" for name, (a, b, _) in _TABLES.items())
        raise NoParameterTable(f"no parameter table for {firmware}; supported are {', '.join(known)}")
    return table(behaviour, firmware.version)


_TABLES: Mapping[
    str, tuple[Version, Version, Callable[[DeclaredBehaviour, Version], tuple[RequiredParameter, ...]]]
] = {
    "ArduCopter": ((4, 5), (4, 7), ardupilot.copter),
    "ArduPlane": ((4, 5), (4, 7), ardupilot.plane),
    "PX4": ((1, 14), (1, 16), px4.copter),
    "PX4 plane": ((1, 14), (1, 16), px4.plane),
}
"""first and last version, and table, by firmware; later versions may have renamed parameters"""
