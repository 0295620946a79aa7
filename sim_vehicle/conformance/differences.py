"""Why a firmware and the simulator differ in a check, in the order in which the patterns are tried."""

from collections.abc import Mapping
from types import MappingProxyType

_TRUSTED = (
    "ArduPilot always accepts unsigned frames on its first serial port (`GCS_Signing.cpp`); "
    "the simulator does so on trusted links only"
)
_QUICK = (
    "the firmware calibrates before it acknowledges; "
    "the simulator answers IN_PROGRESS first, so that ground stations meet that answer"
)

REASONS: Mapping[str, Mapping[str, str]] = MappingProxyType(
    {
        "ArduCopter": MappingProxyType(
            {"signing.refuses_*": _TRUSTED, "commands.progress.can_be_cancelled": _QUICK}
        ),
        "ArduPlane": MappingProxyType(
            {"signing.refuses_*": _TRUSTED, "commands.progress.can_be_cancelled": _QUICK}
        ),
        "PX4": MappingProxyType(
            {
                "reboot.*": "PX4 in software cannot reboot and answers DENIED (`Commander.cpp`, "
                "CONFIG_BOARDCTL_RESET); boards can, and so can the simulator",
                "flight.telemetry.battery": "the battery of PX4's SIH measures no current",
            }
        ),
    }
)
"""Firmware -> pattern of checks -> reason."""
