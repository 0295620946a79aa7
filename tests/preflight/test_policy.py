"""Required parameters of the declared behaviour, by firmware and version."""

from __future__ import annotations

import math
import struct
from typing import Any

import pytest

from swarmctl.agent.replan.landing_pattern import FixedWing
from swarmctl.config.preflight import Policy
from swarmctl.core.records import replace
from swarmctl.mavlink.events import Identity
from swarmctl.mavlink.firmware import Firmware, firmware_of
from swarmctl.preflight.policy import DeclaredBehaviour, NoParameterTable, RequiredParameter, parameters_for
from swarmctl.preflight.policy.required import above_zero

COPTER, PLANE, PX4 = Firmware("ArduCopter", (4, 6)), Firmware("ArduPlane", (4, 6)), Firmware("PX4", (1, 15))
COPTER_47, PX4_PLANE = Firmware("ArduCopter", (4, 7)), Firmware("PX4 plane", (1, 15))
WINGS = FixedWing(
    loiter_radius_m=60.0,
    final_height_m=20.0,
    glide_deg=6.0,
    min_speed_m_s=11.0,
    takeoff_height_m=20.0,
    home=(46.0, 14.4),
)


def wanted(firmware: Firmware, **policy: Any) -> dict[str, RequiredParameter]:
    wings = WINGS if firmware in (PLANE, PX4_PLANE) else None
    intent = DeclaredBehaviour(Policy(**policy), gcs_sysid=255, altitude_m=40.0, ceiling_m=90.0, wings=wings)
    intent = replace(intent, speed_m_s=18.0, turn_radius_m=50.0, extent_m=2500.0)
    return {w.name: w for w in parameters_for(firmware, intent)}


@pytest.mark.parametrize(
    ("firmware", "name", "good", "bad"),
    [
        (COPTER, "GUID_TIMEOUT", [1, 2, 3], [0, 0.1, 5, 10]),
        (COPTER_47, "GUID_TIMEOUT", [3], [10]),
        (PX4, "COM_OBL_RC_ACT", [3, 4, 5], [-1, 0, 1, 2, 6, 7]),
        (PX4, "COM_OF_LOSS_T", [1, 2, 3], [0, 0.5, 5, 60]),
    ],
)
def test_members_of_a_formation_need_a_safe_end_of_set_points(
    firmware: Firmware, name: str, good: list[float], bad: list[float]
) -> None:
    intent = DeclaredBehaviour(Policy(), gcs_sysid=255, altitude_m=40.0, ceiling_m=90.0)
    assert name not in {r.name for r in parameters_for(firmware, intent)}
    parameters = parameters_for(firmware, replace(intent, in_formation=True))
    (required,) = (r for r in parameters if r.name == name)
    assert all(required.accepts(float(value)) for value in good)
    assert not any(required.accepts(float(value)) for value in bad)
    assert required.set_to is not None
    assert required.accepts(required.set_to)


@pytest.mark.parametrize(
    ("firmware", "policy", "name", "good", "bad"),
    [
        (COPTER, {"lost_link": "continue"}, "FS_GCS_ENABLE", [0], [1, 5]),
        (COPTER, {"lost_link": "return"}, "FS_GCS_ENABLE", [1, 3], [0, 2, 4, 5, 7]),
        (COPTER, {"lost_link": "land"}, "FS_GCS_ENABLE", [5], [0, 1, 4]),
        (COPTER, {"lost_link": "hold"}, "FS_GCS_ENABLE", [7], [0, 1]),
        (COPTER, {"lost_link": "land", "lost_link_after_s": 8}, "FS_GCS_TIMEOUT", [8], [5, 9]),
        (COPTER, {"lost_link": "return"}, "FS_OPTIONS", [0, 16, 1], [2, 18, 19, 0.5]),
        (COPTER, {"lost_link": "return"}, "SYSID_MYGCS", [255], [1, 252]),
        (COPTER, {"low_battery": "return"}, "BATT_FS_LOW_ACT", [2, 3], [0, 1, 5]),
        (COPTER, {"low_battery": "land"}, "BATT_FS_LOW_ACT", [1], [0, 2]),
        (COPTER, {}, "BATT_LOW_VOLT", [10.5, 21.6], [0]),
        (COPTER, {}, "BATT_LOW_TIMER", [1, 10, 120], [0]),
        (PLANE, {}, "BATT_LOW_TIMER", [1, 10], [0]),
        (COPTER, {}, "FENCE_ENABLE", [1], [0]),
        (COPTER, {}, "FENCE_TYPE", [5], [0, 1, 4, 7]),
        (COPTER, {}, "FENCE_ALT_MAX", [40, 60, 90], [39.9, 90.1, 0]),
        (COPTER, {"fence_breach": "hold"}, "FENCE_ACTION", [4], [0, 1, 2]),
        (PLANE, {"lost_link": "return"}, "FS_GCS_ENABL", [1], [0, 2]),
        (PLANE, {"lost_link": "return"}, "FS_LONG_ACTN", [1], [0, 2, 3]),
        (PLANE, {"lost_link": "continue"}, "FS_GCS_ENABL", [0], [1]),
        (PLANE, {}, "RTL_AUTOLAND", [1], [0, 2, 3]),
        (PLANE, {}, "RTL_ALTITUDE", [-1, 20, 40, 90], [0, 10, 91, 100]),
        (PLANE, {}, "WP_LOITER_RAD", [60, -60, 45], [61, -61, 80]),
        (PLANE, {}, "RTL_RADIUS", [0, -60, 60], [61, 80]),
        (PLANE, {}, "AIRSPEED_MIN", [9, 11], [12]),
        (PLANE, {}, "AIRSPEED_CRUISE", [18, 17.6, 18.4], [0, 15, 17, 19, 1800]),
        (PLANE, {}, "ROLL_LIMIT_DEG", [34, 45, 65], [0, 30, 33]),
        (PLANE, {}, "WP_MAX_RADIUS", [0], [1, 90]),
        (PLANE, {}, "Q_ENABLE", [0], [1, 2]),
        (COPTER, {}, "BATT_FS_CRT_ACT", [0, 1, 2, 4], [5, 8]),
        (PLANE, {}, "BATT_FS_CRT_ACT", [0, 1, 2], [3, 5]),
        (PX4, {"lost_link": "return"}, "NAV_DLL_ACT", [2], [0, 1, 3, 5, 6]),
        (PX4, {"lost_link": "hold"}, "NAV_DLL_ACT", [1], [0, 2]),
        (PX4, {"lost_link": "return", "lost_link_after_s": 12}, "COM_DL_LOSS_T", [12], [10]),
        (PX4, {"low_battery": "return"}, "COM_LOW_BAT_ACT", [3], [0, 2]),
        (PX4, {"fence_breach": "land"}, "GF_ACTION", [5], [0, 2, 3, 4]),
        (PX4, {}, "GF_MAX_VER_DIST", [40, 90], [0, 100]),
        (PX4, {}, "GF_MAX_HOR_DIST", [0], [200]),
        (COPTER, {}, "RTL_ALT", [0, 1500, 6000], [-100, 6001, 12_000]),
        (COPTER, {}, "RTL_CLIMB_MIN", [0], [500]),
        (COPTER_47, {}, "RTL_ALT_M", [0, 15, 60], [61, 1500]),
        (COPTER_47, {}, "RTL_CLIMB_MIN_M", [0], [5]),
        (COPTER, {}, "RTL_ALT_FINAL", [0], [1, 200, -1]),
        (COPTER_47, {}, "RTL_ALT_FINAL_M", [0], [1, 2]),
        (COPTER, {}, "RTL_LOIT_TIME", [0, 5000, 20_000], [-1, 20_001, 600_000]),
        (COPTER, {}, "RTL_SPEED", [0, 1800, 1750, 2250], [200, 1700, 2300]),
        (COPTER_47, {}, "RTL_SPEED_MS", [0, 18, 22], [2, 1800]),
        (COPTER, {}, "WPNAV_SPEED", [1750, 1800, 1850], [18, 200, 1000, 1700, 1900]),
        (COPTER_47, {}, "WP_SPD", [17.5, 18, 18.5], [2, 10, 17, 1800]),
        (COPTER, {}, "WPNAV_SPEED_UP", [225, 250, 500], [0, 100, 224]),
        (COPTER_47, {}, "WP_SPD_UP", [2.5, 5], [1, 2.2]),
        (COPTER, {}, "WPNAV_SPEED_DN", [135, 150, 300], [50, 134]),
        (COPTER_47, {}, "WP_SPD_DN", [1.5, 3], [0.5]),
        (COPTER, {}, "WPNAV_ACCEL", [225, 250, 500], [100, 200]),
        (COPTER_47, {}, "WP_ACC", [2.5, 5], [1, 2]),
        (COPTER, {}, "WPNAV_RADIUS", [100, 200], [201, 1000]),
        (COPTER_47, {}, "WP_RADIUS_M", [1, 2], [3, 200]),
        (COPTER, {}, "LAND_SPEED", [45, 50, 150], [20, 44]),
        (COPTER_47, {}, "LAND_SPD_MS", [0.45, 0.5, 1], [0.2, 0.4]),
        (COPTER, {}, "LAND_SPEED_HIGH", [0, 150, 300], [50, 134]),
        (COPTER_47, {}, "LAND_SPD_HIGH_MS", [0, 1.5], [0.5]),
        (COPTER, {}, "LAND_ALT_LOW", [500, 1000, 1100], [1101, 4000]),
        (COPTER_47, {}, "LAND_ALT_LOW_M", [5, 10], [12, 1000]),
        (COPTER, {}, "FS_EKF_ACTION", [1, 3], [0, 2, 4]),
        (COPTER_47, {}, "FS_EKF_ACTION", [1, 3], [0, 2]),
        (COPTER, {}, "FS_EKF_THRESH", [0.6, 0.8, 1.0], [0, -1, 1.1, 100]),
        (PX4, {}, "MPC_ACC_HOR", [2.5, 3, 10], [1, 2]),
        (PX4, {}, "NAV_ACC_RAD", [0, 1, 2], [2.5, 10, 30]),
        (PX4, {}, "RTL_RETURN_ALT", [0, 30, 60], [61, 100]),
        (PX4, {}, "RTL_TYPE", [0], [1, 2, 3, 4, 5]),
        (PX4, {}, "RTL_LAND_DELAY", [0, 5, 300], [-1]),
        (PX4, {}, "MPC_XY_CRUISE", [17.5, 18, 18.5], [5, 17, 19]),
        (PX4, {}, "MIS_DIST_1WP", [0, -1, 900, 10000], [100, 500]),
        (PX4_PLANE, {}, "MIS_DIST_1WP", [0, -1, 2500, 10000], [100, 900, 2499]),
        (PX4_PLANE, {"lost_link": "hold"}, "NAV_DLL_ACT", [1], [0, 2, 3]),
        (PX4_PLANE, {"low_battery": "return"}, "COM_LOW_BAT_ACT", [3], [0, 2]),
        (PX4_PLANE, {"fence_breach": "return"}, "GF_ACTION", [3], [0, 2, 5]),
        (PX4_PLANE, {}, "RTL_TYPE", [1], [0, 2, 3, 4, 5]),
        (PX4_PLANE, {}, "RTL_RETURN_ALT", [0, 30, 60], [61, 100]),
        (PX4_PLANE, {}, "NAV_LOITER_RAD", [45, 60], [61, 80, 0, -60]),
        # 20 m down over the 190 m of its final and the 60 before.
        (PX4_PLANE, {}, "FW_LND_ANG", [4.6, 5, 6, 15], [4.5, 3]),
        (PX4_PLANE, {}, "FW_AIRSPD_TRIM", [17.5, 18, 18.5], [17, 19]),
        (PX4_PLANE, {}, "FW_R_LIM", [34, 50], [33]),
        (PX4_PLANE, {}, "NAV_ACC_RAD", [10, 50], [51]),
        (PX4_PLANE, {}, "FW_LND_ABORT", [0, 2], [1, 3]),
        (PX4_PLANE, {}, "NAV_FW_ALT_RAD", [20, 30], [10, 19.9]),
        (PX4_PLANE, {}, "FW_AIRSPD_MIN", [9, 11], [12]),
        (PX4_PLANE, {}, "GF_MAX_VER_DIST", [40, 90], [0, 100]),
    ],
)
def test_declared_values_have_their_parameters(firmware, policy, name, good, bad) -> None:
    parameter = wanted(firmware, **policy)[name]
    assert [value for value in good if not parameter.accepts(float(value))] == []
    no_numbers = [math.nan, math.inf, -math.inf]
    assert [value for value in [*bad, *no_numbers] if parameter.accepts(float(value))] == []
    if parameter.set_to is not None:
        assert parameter.accepts(parameter.set_to)


@pytest.mark.parametrize(
    ("policy", "name"),
    [({"lost_link": "land"}, "NAV_DLL_ACT"), ({"low_battery": "land"}, "COM_LOW_BAT_ACT")],
)
def test_an_immediate_landing_cannot_be_declared_for_a_px4_plane(policy: dict[str, str], name: str) -> None:
    with pytest.raises(NoParameterTable, match=rf"{name} has no value for preflight\.policy\."):
        wanted(PX4_PLANE, **policy)


def test_parameter_names_depend_on_the_firmware_version() -> None:
    watched = {"lost_link": "return"}
    assert "SYSID_MYGCS" in wanted(Firmware("ArduCopter", (4, 6)), **watched)
    assert "MAV_GCS_SYSID" in wanted(Firmware("ArduCopter", (4, 7)), **watched)
    assert "COM_DLL_EXCEPT" not in wanted(Firmware("PX4", (1, 15)), **watched)
    assert "MIS_DIST_1WP" not in wanted(Firmware("PX4", (1, 16)))
    assert wanted(Firmware("PX4", (1, 16)), **watched)["COM_DLL_EXCEPT"].accepts(4.0)
    assert not wanted(Firmware("PX4", (1, 16)), **watched)["COM_DLL_EXCEPT"].accepts(1.0)


@pytest.mark.parametrize(
    ("name", "as_it_comes", "faster"),
    [
        ("WPNAV_SPEED_UP", 250, 500),
        ("WPNAV_SPEED_DN", 150, 300),
        ("LAND_SPEED", 50, 100),
        ("WPNAV_ACCEL", 250, 500),
    ],
)
def test_the_speed_of_a_copter_is_at_most_the_speed_that_other_vehicles_assume(
    name, as_it_comes, faster
) -> None:
    intent = DeclaredBehaviour(
        Policy(), gcs_sysid=255, altitude_m=40.0, ceiling_m=90.0, speed_m_s=10.0, among_others=True
    )
    (parameter,) = (w for w in parameters_for(COPTER, intent) if w.name == name)
    assert parameter.accepts(as_it_comes)
    assert not parameter.accepts(faster)
    assert parameter.set_to is None, "only the owner sets speeds"


@pytest.mark.parametrize("limit", [72.8, 4.1, 0.3])
def test_a_limit_is_accepted_as_a_vehicle_stores_it(limit: float) -> None:
    (stored,) = struct.unpack("<f", struct.pack("<f", limit))
    assert RequiredParameter("FENCE_ALT_MAX", "a fence", limit, least=0.1, most=limit).accepts(stored)
    assert RequiredParameter("RTL_ALTITUDE", "a return", limit, least=limit, most=99.0).accepts(stored)
    assert not above_zero("BATT_LOW_VOLT", "a battery").accepts(0.0)


def test_with_continue_the_details_of_a_lost_link_are_not_required() -> None:
    assert not {"FS_GCS_TIMEOUT", "FS_OPTIONS", "SYSID_MYGCS"} & set(wanted(COPTER, lost_link="continue"))
    assert "COM_DL_LOSS_T" not in wanted(PX4, lost_link="continue")


@pytest.mark.parametrize(
    "firmware",
    [
        Firmware("ArduCopter", (4, 4)),
        Firmware("ArduCopter", (4, 8)),
        Firmware("PX4", (1, 13)),
        Firmware("PX4", (1, 17)),
        Firmware("PX4 plane", (1, 13)),
        Firmware("", (1, 0)),
    ],
    ids=str,
)
def test_a_firmware_without_a_table_is_refused(firmware) -> None:
    with pytest.raises(NoParameterTable, match=r"ArduCopter 4\.5 to 4\.7"):
        wanted(firmware)


def test_the_return_altitude_is_below_a_low_ceiling() -> None:
    low = DeclaredBehaviour(Policy(), gcs_sysid=255, altitude_m=8.0, ceiling_m=12.0)
    for firmware, name, most in ((COPTER, "RTL_ALT", 1200.0), (PX4, "RTL_RETURN_ALT", 12.0)):
        (parameter,) = (w for w in parameters_for(firmware, low) if w.name == name)
        assert parameter.set_to == most
        assert not parameter.accepts(most + 1.0)


def test_an_action_that_a_firmware_lacks_is_refused() -> None:
    with pytest.raises(NoParameterTable, match=r"FENCE_ACTION .*policy\.fence_breach: land"):
        wanted(PLANE, fence_breach="land")


@pytest.mark.parametrize("firmware", [PLANE, PX4_PLANE], ids=str)
def test_a_plane_that_is_configured_as_a_copter_is_refused(firmware) -> None:
    intent = DeclaredBehaviour(Policy(), gcs_sysid=255, altitude_m=40.0, ceiling_m=90.0)
    with pytest.raises(NoParameterTable, match="`airframe: plane`"):
        parameters_for(firmware, intent)


def test_a_correction_changes_only_the_declared_behaviour() -> None:
    options = wanted(COPTER, lost_link="return")["FS_OPTIONS"]
    assert options.corrected(19.0) == 17.0, "the other bits stay"
    assert options.corrected(math.nan) is None, "the other bits are unknown"
    monitor = wanted(COPTER)["BATT_MONITOR"]
    assert monitor.corrected(0.0) is None, "it depends on the built-in monitor"


@pytest.mark.parametrize(
    ("autopilot", "kind", "text", "expected"),
    [
        (3, 2, "ArduPilot 4.6.2", COPTER),
        (3, 1, "ArduPilot 4.6.2", PLANE),
        (12, 2, "PX4 1.15.4", PX4),
        (12, 1, "PX4 1.15.4", PX4_PLANE),
        (12, 2, "PX4", Firmware("PX4", (0, 0))),
        (8, 2, "INVALID 4.6.0", Firmware("", (4, 6))),
    ],
)
def test_the_firmware_of_an_identity(autopilot, kind, text, expected) -> None:
    assert firmware_of(Identity(1, autopilot, kind, text, bytes(18))) == expected
