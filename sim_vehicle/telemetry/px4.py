"""Messages PX4 streams that pymavlink's ArduPilot dialect does not have, by their definitions in MAVLink.

A ground station that does not know them either sees frames of unknown ids, as it does with the real one.
"""

import numpy as np

from sim_vehicle.encode import Layout
from sim_vehicle.telemetry.view import Columns, View

UNKNOWN_TIME_S = -1

TIME_ESTIMATE_TO_TARGET = Layout(
    380,
    "TIME_ESTIMATE_TO_TARGET",
    bytes([232]),
    np.dtype(
        [
            ("safe_return", "<i4"),
            ("land", "<i4"),
            ("mission_next_item", "<i4"),
            ("mission_end", "<i4"),
            ("commanded_action", "<i4"),
        ]
    ),
)
CURRENT_EVENT_SEQUENCE = Layout(
    411, "CURRENT_EVENT_SEQUENCE", bytes([106]), np.dtype([("sequence", "<u2"), ("flags", "u1")])
)
CURRENT_MODE = Layout(
    436,
    "CURRENT_MODE",
    bytes([193]),
    np.dtype([("custom_mode", "<u4"), ("intended_custom_mode", "<u4"), ("standard_mode", "u1")]),
)


def time_estimate_to_target(v: View) -> Columns:
    """The way home at cruising speed [s]; nothing else is estimated."""
    status, dynamics = v.status, v.world.dynamics
    away_m = np.hypot(*(v.world.estimate_m[v.i, :2] - status.origin_m[v.i, :2]).T)
    speed_m_s = np.maximum(np.hypot(dynamics.velocity_m_s[v.i, 0], dynamics.velocity_m_s[v.i, 1]), 5.0)
    others = ("land", "mission_next_item", "mission_end", "commanded_action")
    home_s = np.where(dynamics.airborne[v.i], away_m / speed_m_s, UNKNOWN_TIME_S)
    return {"safe_return": home_s, **dict.fromkeys(others, UNKNOWN_TIME_S)}


def current_event_sequence(_v: View) -> Columns:
    """No events are sent, so the sequence stands at 0."""
    return {"sequence": 0}


def current_mode(v: View) -> Columns:
    mode = v.status.custom_mode[v.i]
    return {"custom_mode": mode, "intended_custom_mode": mode, "standard_mode": v.status.standard_mode[v.i]}
