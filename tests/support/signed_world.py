"""A vehicle and a link that sign."""

from __future__ import annotations

from pathlib import Path

from link_world import BEGAN_US, World
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.links.signing import TICKS_PER_S, Signing, ticks
from swarmctl.security.mavlink_key import TimestampFile

KEY = bytes(range(32))
KEY_AGE_S = 60  # the vehicle's time stamps begin a minute after that of the key


class SignedWorld(World):
    """A simulated copter with a key, and a ground station with the same key, another key or no key."""

    key = KEY

    def __init__(self, folder: Path, *, key: bytes | None = KEY, behind_s: int = 0) -> None:
        self.signing = None if key is None else Signing(key, TimestampFile(folder / "key"))
        super().__init__("ardupilot", signing=self.signing)
        self.give_key(KEY, ticks(BEGAN_US) - (KEY_AGE_S + behind_s) * TICKS_PER_S)

    def give_key(self, key: bytes, timestamp: int) -> None:
        """Give the vehicle a key, as Mission Planner does over USB; all zeros take it away."""
        codec = station(self.key)
        codec.signing.timestamp = ticks(BEGAN_US)
        message = mavlink.MAVLink_setup_signing_message(1, 1, list(key), timestamp)
        self.fleet.receive(bytes(message.pack(codec)), 0.0)
        self.key = key


def station(key: bytes = KEY) -> mavlink.MAVLink:
    codec = mavlink.MAVLink(None, srcSystem=252, srcComponent=190)
    codec.robust_parsing = True
    codec.signing.secret_key, codec.signing.sign_outgoing = key, True
    codec.signing.timestamp, codec.signing.link_id = ticks(BEGAN_US), 9
    return codec
