"""What the vehicle said during the whole run: looked at last."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance.peer import Peer
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.words import Skip, holds


def _said(peer: Peer) -> list[tuple[float, int, str]]:
    if not peer.texts:
        raise Skip("it said nothing")
    return peer.texts


@check("endurance.texts.severities")
def severities(peer: Peer) -> str:
    """Every STATUSTEXT has a MAV_SEVERITY."""
    wrong = [
        (severity, text) for _, severity, text in _said(peer) if severity not in mavlink.enums["MAV_SEVERITY"]
    ]
    holds(not wrong, f"saw {wrong[:2]}")
    return f"{len(peer.texts)} texts"


@check("endurance.texts.are_readable")
def readable(peer: Peer) -> str:
    """Every STATUSTEXT is printable and not empty."""
    wrong = [
        text for _, _, text in _said(peer) if not text.strip() or not text.replace("\t", " ").isprintable()
    ]
    holds(not wrong, f"saw {wrong[:2]!r}")
    return f"{len(peer.texts)} texts"


@check("endurance.still_there")
def still_there(peer: Peer) -> str:
    """After everything the vehicle sends heartbeats and answers."""
    peer.expect("HEARTBEAT", within_s=3.0)
    peer.request("AUTOPILOT_VERSION")
    return f"mode {peer.mode}"
