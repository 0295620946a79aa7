"""Messages of a vehicle by default and on request; equal runs give equal bytes."""

from collections import Counter
from collections.abc import Callable
from typing import Any

import ardupilot_messages as firmware
import pytest
from px4_station import Px4Station
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import LAT_DEG, LON_DEG, VEHICLE, Station, land, scenario, takeoff, waypoint

from sim_vehicle.fleet import Fleet

UNASKED = {"HEARTBEAT", "TIMESYNC", "STATUSTEXT", "HOME_POSITION", "GPS_GLOBAL_ORIGIN"}
ONLY_PX4 = {
    mavlink.MAVLINK_MSG_ID_ACTUATOR_OUTPUT_STATUS,
    mavlink.MAVLINK_MSG_ID_FLIGHT_INFORMATION,
    mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION,
    mavlink.MAVLINK_MSG_ID_ODOMETRY,
}
ASKED_FOR = (firmware.ALWAYS | firmware.COPTER_ONLY | firmware.NOT_IN_MANUAL) - {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT,
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION,
}


@pytest.mark.autopilots("1.1", "MAVSDK 5 telemetry")
def test_without_a_request_there_are_no_streams() -> None:
    station = Station(ready_s=41.0)
    station.wait(60)
    counts = Counter(m.get_type() for m in station.received)
    assert set(counts) == UNASKED
    assert counts["HEARTBEAT"] == 60
    assert counts["HOME_POSITION"] == counts["GPS_GLOBAL_ORIGIN"] == 1


@pytest.mark.autopilots("1.1")
@pytest.mark.parametrize(
    ("make", "message_id"),
    [
        *((Station, message_id) for message_id in sorted(ASKED_FOR)),
        *((Px4Station, m) for m in sorted(ONLY_PX4)),
    ],
)
def test_each_message_has_the_requested_rate_and_can_be_stopped(
    make: Callable[[], Station], message_id: int
) -> None:
    station = make()
    station.stream(message_id, hz=5)
    rate = [m for m in station.wait(10) if m.get_msgId() == message_id]
    assert len(rate) == pytest.approx(50, abs=1)
    assert station.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, -1) == 0
    assert [m for m in station.wait(5) if m.get_msgId() == message_id] == []


def test_landed_state_follows_the_flight() -> None:
    station = Station()
    station.stream(mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE)
    station.wait(1)
    station.fly_mission([takeoff(), waypoint(50, 0), land(50, 0)])
    station.until(lambda: not station.armed)
    states = [m.landed_state for m in station.of("EXTENDED_SYS_STATE")]
    order = [s for i, s in enumerate(states) if i == 0 or s != states[i - 1]]
    assert order == [
        mavlink.MAV_LANDED_STATE_ON_GROUND,
        mavlink.MAV_LANDED_STATE_TAKEOFF,
        mavlink.MAV_LANDED_STATE_IN_AIR,
        mavlink.MAV_LANDED_STATE_LANDING,
        mavlink.MAV_LANDED_STATE_ON_GROUND,
    ]


IMPAIRMENTS = [
    "delay:delay_s=0.3,jitter_s=0.3,sysid=2", "duplication", "reordering:at=4,for=3",
    "sik_radio:sysid=3,at=12", "burst_loss:rate=0.2,at=6", "corruption:rate=0.05,at=6", "absent_ack:rate=0.5",
]  # fmt: skip


def flight_bytes(step_s: float, seed: int = 1) -> list[tuple[int, bytes]]:
    """Return the bytes of a short flight of three vehicles; their input does not depend on the step."""
    vehicles = [VEHICLE | {"sysid": sysid} for sysid in (1, 2, 3)]
    area = {"origin_lat_deg": LAT_DEG, "origin_lon_deg": LON_DEG, "rows": 9, "cols": 9, "cell_size_m": 20}
    extra = {
        "area": area,
        "firing_strength": [0.6, 0.3, 0.1],
        "hostiles": [[1, 0], [3, 1]],
        "seed": seed,
        "faults": IMPAIRMENTS,
    }
    fleet = Fleet(scenario(**extra, vehicles=vehicles), ready_s=0)
    codec = mavlink.MAVLink(None, srcSystem=255)
    out: list[tuple[int, bytes]] = []

    def send(message: Any, now: float) -> None:
        out.extend(fleet.receive(message.pack(codec), now))

    for sysid in (1, 2, 3):
        send(mavlink.MAVLink_request_data_stream_message(sysid, 0, 0, 4, 1), 1.0)
        for command in ((176, 1, 4, 0), (400, 1, 0, 0), (22, 0, 0, 15)):
            params = (command[1], command[2], 0, 0, 0, 0, command[3])
            send(mavlink.MAVLink_command_long_message(sysid, 0, command[0], 0, *params), 1.5)
    target = (460_500_000, 145_061_000, 15)
    for i in range(round(8 / step_s)):
        out.extend(fleet.step(1.5 + i * step_s))
    send(mavlink.MAVLink_command_int_message(0, 0, 6, 192, 0, 0, -1, 1, 0, 0, *target), 10.0)
    for i in range(round(15 / step_s) + 1):
        out.extend(fleet.step(10.0 + i * step_s))
    return out


def test_equal_runs_give_equal_bytes_with_any_step() -> None:
    once = flight_bytes(0.1)
    assert flight_bytes(0.02) == once
    assert flight_bytes(1.0) == once
    assert flight_bytes(0.1, seed=2) != once
    assert any(b"STRIKE" in frame for _, frame in once)
