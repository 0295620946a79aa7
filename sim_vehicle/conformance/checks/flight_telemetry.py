"""Telemetry in flight."""

import math
from functools import partial

from sim_vehicle.conformance import flying, plans
from sim_vehicle.conformance.assertions import Skip, holds, near
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.vehicle import VehicleUnderTest

_copter_check = partial(check, airborne=True, kind="copter", limit_s=300)


@_copter_check("flight.telemetry.velocity")
def velocity(vehicle: VehicleUnderTest) -> str:
    """The distance by vx and vy agrees with the change of the position."""
    flying.reposition(vehicle, plans.offset(flying.last_position(vehicle), 60.0, 60.0), 20.0)
    vehicle.wait(3.0)
    mark = vehicle.wait(4.0)
    messages = vehicle.since(mark, "GLOBAL_POSITION_INT")
    seconds = (messages[-1].time_boot_ms - messages[0].time_boot_ms) / 1000
    first, last = ((m.lat, m.lon) for m in (messages[0], messages[-1]))
    flown_m = plans.distance_m(first, last)
    reported_m = sum(math.hypot(m.vx, m.vy) / 100 for m in messages) / len(messages) * seconds
    holds(flown_m > 3.0, f"expected a flight of more than 3 m, saw {flown_m:.1f} m")
    near(reported_m, flown_m, 0.15 * flown_m + 1.0, "metres by velocity")
    return f"{flown_m:.1f} m flown, {reported_m:.1f} m by velocity"


@_copter_check("flight.telemetry.local_position")
def local_position(vehicle: VehicleUnderTest) -> str:
    """LOCAL_POSITION_NED moves with GLOBAL_POSITION_INT; z is down."""
    rates = {"LOCAL_POSITION_NED": 5.0, "GLOBAL_POSITION_INT": 5.0}
    begin = {k: v[-1] for k, v in vehicle.sample(rates, 1.0).items()}
    flying.start_streams(vehicle)
    flying.reposition(vehicle, plans.offset(flying.last_position(vehicle), -30.0, 30.0), 28.0)
    vehicle.wait(20.0)
    end = {k: v[-1] for k, v in vehicle.sample(rates, 1.0).items()}
    flying.start_streams(vehicle)
    local_a, local_b = begin["LOCAL_POSITION_NED"], end["LOCAL_POSITION_NED"]
    global_a, global_b = begin["GLOBAL_POSITION_INT"], end["GLOBAL_POSITION_INT"]
    local_m = math.hypot(local_b.x - local_a.x, local_b.y - local_a.y)
    near(
        local_m,
        plans.distance_m((global_a.lat, global_a.lon), (global_b.lat, global_b.lon)),
        2.0,
        "metres moved",
    )
    near(local_a.z - local_b.z, (global_b.alt - global_a.alt) / 1000, 1.5, "metres climbed")
    return f"{local_m:.1f} m"


@_copter_check("flight.telemetry.climb")
def climb(vehicle: VehicleUnderTest) -> str:
    """In a climb vz is negative, VFR_HUD.climb is positive, and both agree within 0.6 m/s."""
    place = flying.last_position(vehicle)
    flying.reposition(vehicle, place, flying.height_m(vehicle) + 15.0)
    with vehicle.streaming({"VFR_HUD": 5.0}):
        vehicle.wait(4.0)
        hud, position = vehicle.last["VFR_HUD"].message, vehicle.last["GLOBAL_POSITION_INT"].message
    holds(position.vz < -30, f"vz: expected less than -30 cm/s, saw {position.vz}")
    holds(hud.climb > 0.3, f"climb: expected more than 0.3 m/s, saw {hud.climb:.2f}")
    near(hud.climb, -position.vz / 100, 0.6, "climb [m/s]")
    flying.reposition(vehicle, place, 20.0)
    vehicle.wait(8.0)
    return f"{hud.climb:.2f} m/s"


@check("flight.telemetry.airspeed", airborne=True, kind="plane", limit_s=300)
def airspeed(vehicle: VehicleUnderTest) -> str:
    """The airspeed of a plane is 5 to 60 m/s, and the throttle a percentage."""
    hud = vehicle.sample({"VFR_HUD": 5.0}, 2.0)["VFR_HUD"][-1]
    holds(5 < hud.airspeed < 60, f"airspeed: expected 5 to 60 m/s, saw {hud.airspeed:.1f}")
    holds(0 <= hud.throttle <= 100, f"throttle: expected 0 to 100 %, saw {hud.throttle}")
    return f"{hud.airspeed:.1f} m/s, {hud.throttle} %"


@check("flight.telemetry.battery", airborne=True, limit_s=300)
def battery(vehicle: VehicleUnderTest) -> str:
    """In the air a current above 0.5 A flows, the consumption grows, and the remaining charge does not."""
    first = vehicle.request("BATTERY_STATUS")
    vehicle.wait(10.0)
    second = vehicle.request("BATTERY_STATUS")
    if second.current_battery < 0:
        raise Skip("the current is not measured")
    holds(second.current_battery > 50, f"current: expected more than 50 cA, saw {second.current_battery}")
    used_mah = second.current_consumed - first.current_consumed
    holds(used_mah > 0, f"consumption: expected growth in 10 s, saw {used_mah} mAh")
    holds(second.battery_remaining <= first.battery_remaining, "the remaining charge grew")
    return f"{second.current_battery / 100:.1f} A, {used_mah} mAh in 10 s"
