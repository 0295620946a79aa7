"""Reboots on the ground: acknowledgement, lost and kept state."""

import math
from functools import partial

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, parameters, plans
from sim_vehicle.conformance.assertions import at_least, at_most, equal, holds, within
from sim_vehicle.conformance.checks.fence import polygon
from sim_vehicle.conformance.guard import ARM, REBOOT
from sim_vehicle.conformance.outcomes import ACCEPTED, Skip
from sim_vehicle.conformance.registry import KNOWN, check
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.definitions import id_of

MIN_UPTIME_S = 20.0  # shortest time since the boot before a reboot; a lower time afterwards proves it
MAX_REBOOT_S = 60.0  # longest time from the reboot to an answer
SETTLE_S = 3.0  # wait after a boot, because the vehicle undoes a mode change made in this time
PREFLIGHT = mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN
_check = partial(check, "reboot", needs=[REBOOT])


def _boot_ms(vehicle: VehicleUnderTest) -> int:
    return int(vehicle.request("SYSTEM_TIME").time_boot_ms)


def _reboot(vehicle: VehicleUnderTest) -> float:
    """Reboot the vehicle and wait until it answers again; return the time taken [s].

    The reboot waits until `MIN_UPTIME_S`, because a lower time_boot_ms proves the new boot. Raises Skip if
    the vehicle refuses.
    """
    vehicle.wait(max(0.0, MIN_UPTIME_S - _boot_ms(vehicle) / 1000))
    before_ms = _boot_ms(vehicle)
    result = vehicle.command(PREFLIGHT, 1)
    if result in ("DENIED", "UNSUPPORTED"):
        raise Skip(f"the vehicle does not reboot on command ({result})")
    equal(result, ACCEPTED, "PREFLIGHT_REBOOT_SHUTDOWN")
    rebooted_s = vehicle.now
    vehicle.wait(1.0)
    end_s = vehicle.now + MAX_REBOOT_S
    while vehicle.now < end_s:
        if vehicle.wait_for("HEARTBEAT", within_s=3.0) is None:
            continue
        for _ in range(3):
            vehicle.send(vehicle.command_long(mavlink.MAV_CMD_REQUEST_MESSAGE, id_of("SYSTEM_TIME")))
            answer = vehicle.wait_for("SYSTEM_TIME", within_s=1.0)
            if answer is not None and answer.time_boot_ms < before_ms:
                took_s = vehicle.now - rebooted_s
                vehicle.wait(SETTLE_S)
                return took_s
    holds(False, f"expected SYSTEM_TIME of a new boot within {MAX_REBOOT_S:g} s, saw none")
    return MAX_REBOOT_S


@_check(source="AUTOPILOTS 1.18: Reboot (246)")
def answers_again(vehicle: VehicleUnderTest) -> str:
    """A reboot is acknowledged, and the vehicle answers again within 60 s."""
    return f"after {_reboot(vehicle):.1f} s"


@_check()
def clock_restarts(vehicle: VehicleUnderTest) -> str:
    """time_boot_ms counts from the boot."""
    took_s = _reboot(vehicle)
    seen_ms = _boot_ms(vehicle)
    return f"{at_most(seen_ms, (took_s + SETTLE_S + 2) * 1000, 'time_boot_ms')} ms"


@_check(source="AUTOPILOTS 1.1: Re-request after a reboot")
def streams_are_forgotten(vehicle: VehicleUnderTest) -> str:
    """After a reboot, ArduCopter streams no attitude without a request, ArduPlane 1 Hz, PX4 15 Hz or more."""
    low_hz, high_hz = vehicle.known(ardupilot=(0.0, 2.0), px4=(0.2, math.inf))
    vehicle.set_interval("ATTITUDE", 8)
    _reboot(vehicle)
    seen_hz = within(len(vehicle.listen("ATTITUDE", 5.0)) / 5.0, low_hz, high_hz, "ATTITUDE [Hz]")
    return f"ATTITUDE at {seen_hz:g} Hz"


@_check(dialects=("ardupilot",), source="AUTOPILOTS 1.2: At every boot the link carries plain text")
def text_on_the_link(vehicle: VehicleUnderTest) -> str:
    """A boot writes plain text to the link."""
    _reboot(vehicle)
    text = bytes(vehicle.noise).decode("ascii", "replace")
    holds("Init Ardu" in text, f"expected 'Init Ardu...', saw {text[:40]!r}")
    return text.strip().partition("\n")[0]


@_check()
def parameters_stay(vehicle: VehicleUnderTest) -> str:
    """A changed parameter survives a reboot."""
    name, value = parameters.harmless_change(vehicle, vehicle.dialect.integer_parameters)
    with parameters.changed(vehicle, name, value):
        vehicle.wait(1.0)
        _reboot(vehicle)
        equal(parameters.read(vehicle, name).value, value, name)
    return f"{name} = {value}"


@_check(dialects=KNOWN)
def mission_stays(vehicle: VehicleUnderTest) -> None:
    """The mission survives a reboot."""
    items = plans.store_sample(vehicle)
    vehicle.wait(1.0)
    _reboot(vehicle)
    plans.expect_stored(vehicle, items)


@_check(dialects=KNOWN, claims=["MISSION_FENCE"])
def fence_stays(vehicle: VehicleUnderTest) -> None:
    """The fence survives a reboot."""
    plans.upload_or_fail(vehicle, polygon(vehicle), plans.FENCE)
    vehicle.wait(1.0)
    _reboot(vehicle)
    seen = plans.count(vehicle, plans.FENCE)
    plans.upload_or_fail(vehicle, [], plans.FENCE)
    equal(seen, 4, "fence items")


@check("reboot", needs=[REBOOT, ARM], source="AUTOPILOTS 1.3: Wait about 41 s")
def not_ready_at_once(vehicle: VehicleUnderTest) -> str:
    """After a boot a known autopilot refuses arming with a text; a vehicle that reports readiness arms."""
    if vehicle.dialect.refusal is None:
        raise Skip("the refusals of this autopilot are unknown")
    _reboot(vehicle)
    flying.set_ready_mode(vehicle)
    holds(not flying.is_ready(vehicle), "the vehicle reported to be ready at once")
    mark = vehicle.mark()
    result = vehicle.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    equal(result, vehicle.dialect.refusal, "arming before readiness")
    vehicle.wait(1.0)
    vehicle.expect_text("", mark)
    took_s = flying.wait_ready(vehicle)
    flying.arm(vehicle)
    flying.disarm(vehicle)
    return f"ready {took_s:.0f} s later"


@_check()
def zero_parameters(vehicle: VehicleUnderTest) -> str:
    """PREFLIGHT_REBOOT_SHUTDOWN with all parameters 0 does not reboot."""
    before_ms = _boot_ms(vehicle)
    result = vehicle.command(PREFLIGHT, 0)
    vehicle.wait(3.0)
    at_least(_boot_ms(vehicle), before_ms, "time_boot_ms")
    return result
