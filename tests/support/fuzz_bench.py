"""Hostile ground stations of a small fleet, and the invariants under any input."""

import math
from collections import Counter
from collections.abc import Hashable
from typing import Any

from pymavlink.dialects.v20 import all as every
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import ALT_M, LAT_DEG, LON_DEG, VEHICLE

from sim_vehicle.fleet import Fleet
from sim_vehicle.scenarios import Scenario
from sim_vehicle.station.messages import command_long

CRAFT = [(name, kind) for name in ("ardupilot", "px4") for kind in ("copter", "plane")]
STATIONS = ((255, 190), (254, 1))
STEP_S = 0.1
FLUSH = b"\0" * 300  # longer than the longest frame: a length byte in garbage may span a whole frame
KEY = bytes(range(7, 39))
BOOT_S = 1.5
# Messages whose fields may hold no number, as their descriptions say; NaN in any other frame is a mistake.
SET_POINT = {"vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate"}
NAN_ALLOWED = {
    "ALTITUDE": {"bottom_clearance"},  # not measured
    "ODOMETRY": {"pose_covariance", "velocity_covariance"},
    "PARAM_VALUE": {"param_value"},  # may be the bytes of an integer
    # ignored fields
    "POSITION_TARGET_LOCAL_NED": {"x", "y", "z", *SET_POINT},
    "POSITION_TARGET_GLOBAL_INT": SET_POINT,
    "MISSION_ITEM": {"param1", "param2", "param3", "param4", "z"},  # as uploaded
    "MISSION_ITEM_INT": {"param1", "param2", "param3", "param4", "z"},
}


def scenario(name: str, kind: str) -> Scenario:
    """Return two vehicles of a kind, far apart."""
    craft = VEHICLE | {"personality": name, "kind": kind}
    vehicles = [craft | {"sysid": sysid, "lon_deg": LON_DEG + 1e-3 * sysid} for sysid in (1, 2)]
    return Scenario.model_validate({"seed": 1, "vehicles": vehicles})


class Bench:
    """A fleet of two and its stations; every received byte is checked."""

    def __init__(self, name: str, kind: str) -> None:
        self.name, self.kind = name, kind
        self.fleet = Fleet(scenario(name, kind), ready_s=0.0)
        self.now = 0.0
        self.raw: list[bytes] = []
        self.received: list[tuple[float, Any]] = []
        self.most_frames = 0  # most frames in answer to one frame
        self._codecs = {station: mavlink.MAVLink(None, *station) for station in STATIONS}
        self._hearing = every.MAVLink(None)
        self._hearing.robust_parsing = True
        self.wait(STEP_S)

    # -- messages ----------------------------------------------------------------------------------------

    def frame(self, message: Any, station: int = 0, *, mavlink1: bool = False) -> bytes:
        codec = self._codecs[STATIONS[station]]
        codec.seq = (codec.seq + 1) % 256
        codec.signing.timestamp = max(codec.signing.timestamp, 10**12 + 1 + round(self.now * 1e5))
        return bytes(message.pack(codec, force_mavlink1=mavlink1))

    def send(self, message: Any, station: int = 0, *, mavlink1: bool = False) -> list[Any]:
        """Send a message and return the immediate answers."""
        return self.put(self.frame(message, station, mavlink1=mavlink1), peer=station)

    def put(self, data: bytes, peer: Hashable = 0) -> list[Any]:
        self._take(self.fleet.step(self.now))
        frames = self.fleet.receive(data, self.now, peer=peer)
        self.most_frames = max([self.most_frames, *Counter(index for index, _ in frames).values()])
        return self._take(frames)

    def wait(self, seconds: float) -> list[Any]:
        before = len(self.received)
        end = self.now + seconds
        while self.now < end - 1e-9:
            self.now = min(self.now + STEP_S, end)
            self._take(self.fleet.step(self.now))
        return [message for _, message in self.received[before:]]

    def _take(self, frames: list[tuple[int, bytes]]) -> list[Any]:
        made = []
        for index, frame in frames:
            self.raw.append(frame)
            for message in self._hearing.parse_buffer(frame) or ():
                self._look_at(index, frame, message)
                made.append(message)
        self.received += [(self.now, message) for message in made]
        return made

    def _look_at(self, index: int, frame: bytes, message: Any) -> None:
        """Check that all output is whole frames with finite numbers."""
        if message.get_type() == "BAD_DATA":
            assert frame in self.fleet.vehicles[index].personality.identity.boot_text, frame
            return
        assert frame[5] == self.fleet.sysids[index], message
        may_be_none = NAN_ALLOWED.get(message.get_type(), set())
        for field, value in message.to_dict().items():
            for number in value if isinstance(value, list) else [value]:
                if isinstance(number, float) and field not in may_be_none:
                    assert math.isfinite(number), message

    def command(self, command: int, *params: float, sysid: int = 1) -> int | None:
        """Send COMMAND_LONG and return its immediate result, or None."""
        replies = self.send(command_long((sysid, 1), command, *params))
        acks = [m.result for m in replies if m.get_type() == "COMMAND_ACK" and m.command == command]
        return acks[-1] if acks else None

    def fly(self) -> None:
        """Take off with both vehicles."""
        for sysid in (1, 2):
            take_off = mavlink.MAV_CMD_NAV_TAKEOFF
            if self.name == "px4":
                assert self.command(take_off, 0, 0, 0, *[math.nan] * 3, ALT_M + 30, sysid=sysid) == 0
            else:
                mode = 4 if self.kind == "copter" else 13
                assert self.command(mavlink.MAV_CMD_DO_SET_MODE, 1, mode, sysid=sysid) == 0
            assert self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, sysid=sysid) == 0
            if self.name == "ardupilot" and self.kind == "copter":
                assert self.command(take_off, 0, 0, 0, 0, 0, 0, 30, sysid=sysid) == 0
        self.wait(12.0)
        assert self.fleet.truth().airborne.all()

    def begin_upload(self) -> None:
        """Start an upload to both vehicles, which then wait for the second of five items."""
        for sysid in (1, 2):
            self.send(mavlink.MAVLink_mission_count_message(sysid, 1, 5, 0))
            self.send(
                mavlink.MAVLink_mission_item_int_message(
                    sysid, 1, 0, 3, 22, 0, 1, 0, 0, 0, 0, round(LAT_DEG * 1e7), round(LON_DEG * 1e7), 20.0, 0
                )
            )

    def sign(self, *sysids: int) -> None:
        """Set a key on the vehicles and sign from now on."""
        for sysid in sysids or (1, 2):
            self.send(mavlink.MAVLink_setup_signing_message(sysid, 1, KEY, 10**12))
        for link, codec in enumerate(self._codecs.values()):
            codec.signing.secret_key = KEY
            codec.signing.link_id = link
            codec.signing.timestamp = 10**12 + 1
            codec.signing.sign_outgoing = True

    def set_signatures(self, *, on: bool) -> None:
        """Sign the stations' messages with their key, or send them unsigned."""
        for codec in self._codecs.values():
            codec.signing.sign_outgoing = on

    # -- invariants --------------------------------------------------------------------------------------

    def sent(self) -> bytes:
        """Return every byte from the fleet."""
        return b"".join(self.raw)

    def check(self) -> None:
        """Check that both vehicles send heartbeats, have a position and answer both stations."""
        for station in range(len(STATIONS)):
            self.put(FLUSH, peer=station)
        self.put(FLUSH, peer="noise")
        self.wait(BOOT_S + STEP_S)  # a reboot may have been requested
        for sysid in (1, 2):  # an attack may have changed or stopped the heartbeats
            self.command(
                mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_HEARTBEAT, 0, sysid=sysid
            )
        beats = {m.get_srcSystem() for m in self.wait(2.1) if m.get_type() == "HEARTBEAT"}
        truth, world = self.fleet.truth(), self.fleet.world
        columns = (
            truth.lat_deg, truth.lon_deg, truth.alt_amsl_m, truth.speed_m_s, truth.battery_remaining,
            world.dynamics.position, world.dynamics.velocity, world.dynamics.attitude,
            world.dynamics.estimate, world.batteries.voltage_v, world.batteries.used_mah, world.wind.now,
        )  # fmt: skip
        for column in columns:
            assert all(map(math.isfinite, column.ravel().tolist())), column
        assert (truth.height_m >= -1e-6).all()
        assert (abs(truth.lat_deg) <= 90).all()
        assert beats == {1, 2}
        for station in range(len(STATIONS)):
            for sysid in (1, 2):
                found = self._answered(sysid, station)
                assert found, f"vehicle {sysid} does not answer station {station}"

    def _answered(self, sysid: int, station: int) -> bool:
        version = mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION
        asked = command_long((sysid, 1), mavlink.MAV_CMD_REQUEST_MESSAGE, version)
        replies = [*self.send(asked, station), *self.wait(STEP_S)]
        return {"COMMAND_ACK", "AUTOPILOT_VERSION"} <= {
            m.get_type() for m in replies if m.get_srcSystem() == sysid
        }
