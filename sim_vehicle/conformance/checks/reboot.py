"""Rebooting on the ground: what is said, what is forgotten, what stays."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, parameters, plans
from sim_vehicle.conformance.checks.fence import polygon
from sim_vehicle.conformance.guard import ARM, REBOOT
from sim_vehicle.conformance.peer import Peer, known
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.words import Skip, equal, holds, result_name

BACK_S = 60.0
YOUNG_MS = 45_000
SETTLE_S = 3.0  # a mode that is set earlier is undone
PREFLIGHT = mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN


def _boot_ms(peer: Peer) -> int:
    return int(peer.request("SYSTEM_TIME").time_boot_ms)


def _reboot(peer: Peer) -> float:
    """Reboot and wait until it is back; for how long it was silent [s]."""
    before_ms = _boot_ms(peer)
    equal(result_name(peer.command(PREFLIGHT, 1)), "ACCEPTED", "PREFLIGHT_REBOOT_SHUTDOWN")
    gone_s = peer.now
    peer.wait(1.0)
    end_s = peer.now + BACK_S
    while peer.now < end_s:
        if peer.maybe("HEARTBEAT", within_s=3.0) is None:
            continue
        for _ in range(3):
            mark = peer.mark()
            peer.send(peer.command_long(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_SYSTEM_TIME))
            answer = peer.maybe("SYSTEM_TIME", within_s=1.0, mark=mark)
            if answer is not None and answer.time_boot_ms < max(before_ms, YOUNG_MS):
                took_s = peer.now - gone_s
                peer.wait(SETTLE_S)
                return took_s
    holds(False, f"expected it to be back within {BACK_S:g} s")
    return BACK_S


@check("reboot.comes_back", needs=[REBOOT], limit_s=120, pins="AUTOPILOTS 1.18: Reboot (246)")
def comes_back(peer: Peer) -> str:
    """A reboot is acknowledged, and the vehicle is heard again within a minute."""
    return f"after {_reboot(peer):.1f} s"


@check("reboot.clock_begins_anew", needs=[REBOOT], limit_s=120)
def clock_begins_anew(peer: Peer) -> str:
    """time_boot_ms counts from the boot."""
    took_s = _reboot(peer)
    seen_ms = _boot_ms(peer)
    holds(seen_ms <= (took_s + SETTLE_S + 2) * 1000, f"{seen_ms} ms after a boot {took_s:.1f} s ago")
    return f"{seen_ms} ms"


@check(
    "reboot.streams_are_forgotten",
    needs=[REBOOT],
    limit_s=120,
    pins="AUTOPILOTS 1.1: Re-request after a reboot",
)
def streams_forgotten(peer: Peer) -> str:
    """After a reboot ArduPilot streams nothing until it is asked; PX4's own streams flow, not ours."""
    flows = known(peer, ardupilot=False, px4=True)
    peer.set_interval("ATTITUDE", 8)
    _reboot(peer)
    mark = peer.wait(5.0)
    seen = {e.kind for e in peer.heard[mark:]}
    if flows:
        holds("ATTITUDE" in seen, "the default streams do not flow")
        return f"{len(seen)} kinds of message"
    peer.last.pop("ATTITUDE", None)
    holds(
        "ATTITUDE" not in seen and "GLOBAL_POSITION_INT" not in seen,
        f"streams without a request: {sorted(seen)}",
    )
    return f"only {', '.join(sorted(seen))}"


@check(
    "reboot.text_on_the_link",
    needs=[REBOOT],
    dialects=("ardupilot",),
    limit_s=120,
    pins="AUTOPILOTS 1.2: At every boot the link carries plain text",
)
def boot_text(peer: Peer) -> str:
    """The boot writes plain text on the link."""
    _reboot(peer)
    text = bytes(peer.noise).decode("ascii", "replace")
    holds("Init Ardu" in text, f"expected 'Init Ardu...', saw {text[:40]!r}")
    return text.strip().partition("\n")[0]


@check("reboot.parameters_stay", needs=[REBOOT], limit_s=200)
def parameters_stay(peer: Peer) -> str:
    """A parameter that was set is still set."""
    name, value = parameters.harmless(peer, peer.dialect.whole_parameters)
    with parameters.changed(peer, name, value):
        peer.wait(1.0)
        _reboot(peer)
        equal(parameters.read(peer, name).value, value, name)
    return f"{name} = {value}"


@check("reboot.mission_stays", needs=[REBOOT], limit_s=200)
def mission_stays(peer: Peer) -> str:
    """The mission is still there."""
    known(peer, ardupilot=True, px4=True)
    items = plans.sample_plan(peer)
    plans.put(peer, items)
    peer.wait(1.0)
    _reboot(peer)
    equal(plans.body(peer, plans.download(peer)), plans.body(peer, items), "items")
    return f"{len(items)} items"


@check("reboot.fence_stays", needs=[REBOOT], claims=["MISSION_FENCE"], limit_s=200)
def fence_stays(peer: Peer) -> str:
    """The fence is still there."""
    known(peer, ardupilot=True, px4=True)
    plans.put(peer, polygon(peer), plans.FENCE)
    peer.wait(1.0)
    _reboot(peer)
    seen = plans.count(peer, plans.FENCE)
    plans.put(peer, [], plans.FENCE)
    equal(seen, 4, "fence items")
    return "4 items"


@check("reboot.not_ready_at_once", needs=[REBOOT, ARM], limit_s=300, pins="AUTOPILOTS 1.3: Wait about 41 s")
def not_ready_at_once(peer: Peer) -> str:
    """After a boot arming is refused until the vehicle says that it is ready, and accepted then."""
    if peer.dialect.arm_refused is None:
        raise Skip("nobody knows how this autopilot refuses")
    _reboot(peer)
    flying.ready_mode(peer)
    if flying.is_ready(peer):
        raise Skip("it is ready at once")
    began_s = peer.now
    result = peer.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    equal(result_name(result), result_name(peer.dialect.arm_refused), "arming too early")
    peer.wait(1.0)
    holds(any(at_s >= began_s for at_s, _, _ in peer.texts), "no text says why")
    took_s = flying.wait_ready(peer)
    flying.arm(peer)
    flying.disarm(peer)
    return f"ready {took_s:.0f} s later"


@check("reboot.nothing_asked", needs=[REBOOT], limit_s=60)
def nothing_asked(peer: Peer) -> str:
    """PREFLIGHT_REBOOT_SHUTDOWN with all parameters 0 does not reboot."""
    before_ms = _boot_ms(peer)
    result = peer.command(PREFLIGHT, 0)
    peer.wait(3.0)
    holds(_boot_ms(peer) > before_ms, "it rebooted")
    return result_name(result)
