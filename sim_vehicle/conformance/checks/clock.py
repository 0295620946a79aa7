"""The vehicle's clock: TIMESYNC, SYSTEM_TIME, PING."""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance.assertions import at_least, equal, near, within
from sim_vehicle.conformance.outcomes import Skip
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.station.frames import STATION

MAX_SPEEDUP = 20.0  # of a simulation with the date of its host
Y2020_S = 1_577_836_800


def _ask_timesync(vehicle: VehicleUnderTest, ts1: int) -> Any:
    message = mavlink.MAVLink_timesync_message(0, ts1)
    return vehicle.ask(message, "TIMESYNC", lambda m: m.ts1 == ts1 and m.tc1 != 0)


@check("time.timesync")
def is_answered(vehicle: VehicleUnderTest) -> str:
    """The answer to a TIMESYNC request (tc1 = 0) has the same ts1, and the vehicle's time as tc1."""
    return f"{at_least(_ask_timesync(vehicle, 123_456_789_012).tc1 / 1e9, 0, 'time [s]'):.3f} s"


@check("time.timesync")
def goes_forward(vehicle: VehicleUnderTest) -> str:
    """The vehicle's clock advances by the time between two answers, within 15 %."""
    first_ns, began_s = _ask_timesync(vehicle, 1_001).tc1, vehicle.now
    vehicle.wait(3.0)
    second_ns, passed_s = _ask_timesync(vehicle, 1_002).tc1, vehicle.now - began_s
    seen_s = near((second_ns - first_ns) / 1e9, passed_s, 0.15 * passed_s, "seconds between two answers")
    return f"{seen_s:.3f} s in {passed_s:.3f} s"


@check("time.timesync")
def answer_is_not_answered(vehicle: VehicleUnderTest) -> None:
    """The vehicle does not reply to a TIMESYNC answer (tc1 not 0)."""
    _ask_timesync(vehicle, 666_666)  # confirms that the vehicle answers
    vehicle.send(mavlink.MAVLink_timesync_message(5_000_000_000, 777_777))
    vehicle.expect_none("TIMESYNC", lambda m: m.ts1 == 777_777, during_s=1.5)


@check("time.system_time")
def agrees_with_timesync(vehicle: VehicleUnderTest) -> str:
    """time_boot_ms and TIMESYNC count from the same moment, within 1 s."""
    clock_s = _ask_timesync(vehicle, 2_001).tc1 / 1e9
    boot_s = vehicle.request("SYSTEM_TIME").time_boot_ms / 1000
    near(boot_s, clock_s, 1.0, "seconds since boot")
    return f"{boot_s:.2f} s and {clock_s:.2f} s"


@check("time.system_time")
def has_the_date(vehicle: VehicleUnderTest) -> str:
    """With a GPS fix, time_unix_usec is a date after the start of 2020."""
    for _ in range(100):
        message = vehicle.request("SYSTEM_TIME")
        if message.time_unix_usec:
            return f"{at_least(message.time_unix_usec / 1e6, Y2020_S, 'date [s]'):.0f} s since 1970"
        vehicle.wait(1.0)
    raise Skip("no GPS time in 100 requests")


@check("time.system_time", source="PX4 SYSTEM_TIME.hpp: the date of the host, in SITL")
def same_rate(vehicle: VehicleUnderTest) -> str:
    """The date advances with the time since boot; a fast simulation may keep the slower date of its host."""
    first = vehicle.request("SYSTEM_TIME")
    if not first.time_unix_usec:
        raise Skip("no GPS time")
    vehicle.wait(4.0)
    second = vehicle.request("SYSTEM_TIME")
    boot_s = (second.time_boot_ms - first.time_boot_ms) / 1000
    date_s = (second.time_unix_usec - first.time_unix_usec) / 1e6
    slowest_s = boot_s / MAX_SPEEDUP if vehicle.dialect.name == "px4" else boot_s
    within(date_s, max(0.001, slowest_s - 0.3), boot_s + 0.3, "seconds of the date")
    return f"{boot_s:.2f} s, {date_s:.2f} s of the date"


@check("time", dialects=("px4",))
def ping(vehicle: VehicleUnderTest) -> None:
    """The answer to a PING to all systems has the seq and time_usec of the PING."""
    stamp = 987_654
    answer = vehicle.ask(
        mavlink.MAVLink_ping_message(stamp, 42, 0, 0), "PING", lambda m: m.target_system == STATION[0]
    )
    equal((answer.seq, answer.time_usec), (42, stamp), "seq and time_usec")
