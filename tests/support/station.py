"""A ground station for tests: pymavlink as the independent codec, virtual time, a fleet behind it."""

from collections.abc import Callable, Sequence
from typing import Any

from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.faults.spec import parse_fault
from sim_vehicle.fleet import Fleet
from sim_vehicle.scenarios import Scenario
from sim_vehicle.station.exchanges import UploadPlan
from sim_vehicle.station.frames import Receiver
from sim_vehicle.station.messages import MISSION, PlanItem, command_int, command_long, heartbeat, joined_texts

LAT_DEG, LON_DEG, ALT_M = 46.0490, 14.5060, 300.0
STEP_S = 0.1
WITHOUT_LOG = {"LOG_BACKEND_TYPE": 0}
"""ArduPilot without its on-board log, which takes a quarter of the time of a flight."""


MODES = {
    "copter": mavutil.mode_mapping_byname(mavlink.MAV_TYPE_QUADROTOR),
    "plane": mavutil.mode_mapping_byname(mavlink.MAV_TYPE_FIXED_WING),
}
VEHICLE = {"sysid": 1, "lat_deg": LAT_DEG, "lon_deg": LON_DEG, "alt_amsl_m": ALT_M}


def scenario(**extra: Any) -> Scenario:
    # Tests to the centimetre have no receiver noise.
    quiet = {"gps": {"noise_m": 0.0, "drift_m": 0.0}}
    return Scenario.model_validate({"seed": 1, "vehicles": [VEHICLE], **quiet, **extra})


def fleet_of(
    kind: str = "copter",
    params: dict[str, float] | None = None,
    *,
    personality: str = "ardupilot",
    ready_s: float | None = 0.0,
    **extra: Any,
) -> Fleet:
    """Return a fleet of one vehicle; an ArduPilot is without a log."""
    quick = WITHOUT_LOG if personality == "ardupilot" else {}
    vehicle = VEHICLE | {"kind": kind, "personality": personality, "params": quick | (params or {})}
    return Fleet(scenario(vehicles=[vehicle], **extra), ready_s=ready_s)


def item(
    command: int, north_m: float = 0.0, east_m: float = 0.0, z: float = 0.0, **fields: Any
) -> dict[str, Any]:
    """Return a mission item at metres from the start; frame relative to home."""
    lat_deg = LAT_DEG + north_m / 111_195.0
    lon_deg = LON_DEG + east_m / 77_450.0
    values: dict[str, Any] = {
        "frame": mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
        "command": command,
        "param1": 0.0,
        "param2": 0.0,
        "param3": 0.0,
        "param4": 0.0,
        "x": round(lat_deg * 1e7),
        "y": round(lon_deg * 1e7),
        "z": z,
    }
    return values | fields


def plan_item(fields: dict[str, Any]) -> PlanItem:
    f = fields
    params = (f["param1"], f["param2"], f["param3"], f["param4"])
    return PlanItem(f["command"], f["x"], f["y"], f["z"], f["frame"], params)


def home_item() -> dict[str, Any]:
    return item(mavlink.MAV_CMD_NAV_WAYPOINT, frame=mavlink.MAV_FRAME_GLOBAL)


def takeoff(z: float = 20.0) -> dict[str, Any]:
    return item(mavlink.MAV_CMD_NAV_TAKEOFF, z=z)


def waypoint(north_m: float, east_m: float, z: float = 20.0, **fields: Any) -> dict[str, Any]:
    return item(mavlink.MAV_CMD_NAV_WAYPOINT, north_m, east_m, z, **fields)


def land(north_m: float, east_m: float) -> dict[str, Any]:
    return item(mavlink.MAV_CMD_NAV_LAND, north_m, east_m)


def landing_mission() -> list[dict[str, Any]]:
    """Return a mission of an ArduPlane, with its home and a landing sequence from item 3."""
    start = item(mavlink.MAV_CMD_DO_LAND_START, 200, 600)
    return [home_item(), takeoff(50), waypoint(3000, 0, 60), start, waypoint(0, 600, 40), land(0, 0)]


def place_m(station: "Station") -> tuple[float, float]:
    """Return the true position of the vehicle: north and east of the start [m]."""
    truth = station.fleet.truth()
    return (truth.lat_deg[0] - LAT_DEG) * 111_195, (truth.lon_deg[0] - LON_DEG) * 77_450


class Station:
    """A ground station of one vehicle; `received` keeps every message, `raw` every byte.

    By default the vehicle is an ArduCopter without a log.
    """

    def __init__(
        self, fleet: Fleet | None = None, *, ready_s: float = 0.0, sysid: int = 255, target: int = 1
    ) -> None:
        self.fleet = fleet or fleet_of(ready_s=ready_s)
        self.now = 0.0
        self.target = target
        self.codec = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=190)
        self.receiver = Receiver()
        self.received: list[Any] = []
        self.raw = b""
        self._take(self.fleet.step(0.0))

    def _take(self, frames: Sequence[tuple[int, bytes]]) -> None:
        for index, frame in frames:
            sysid = self.fleet.sysids[index]
            self.raw += frame
            messages = self.receiver.messages(frame)
            self.received += messages if sysid == self.target else []

    def send(self, message: Any) -> list[Any]:
        """Send a message; return the immediate answers."""
        return self.send_bytes(message.pack(self.codec))

    def send_bytes(self, data: bytes) -> list[Any]:
        before = len(self.received)
        self._take(self.fleet.receive(data, self.now))
        return self.received[before:]

    def wait(self, seconds: float) -> list[Any]:
        before = len(self.received)
        end = self.now + seconds
        while self.now < end - 1e-9:
            self.now = min(self.now + STEP_S, end)
            self._take(self.fleet.step(self.now))
        return self.received[before:]

    def until(self, condition: Callable[[], bool], limit_s: float = 300.0) -> float:
        """Advance time until `condition`; return the elapsed time [s]."""
        start = self.now
        while not condition():
            assert self.now - start < limit_s, f"not within {limit_s} s; last texts: {self.texts()[-5:]}"
            self.wait(STEP_S)
        return self.now - start

    # -- conversations -----------------------------------------------------------------------------------

    def _result(self, request: Any) -> int:
        """Send a command; return the acknowledged result."""
        replies = self.send(request)
        (ack,) = [m for m in replies if m.get_type() == "COMMAND_ACK" and m.command == request.command]
        return int(ack.result)

    def command(self, command: int, *params: float) -> int:
        return self._result(command_long((self.target, 0), command, *params))

    def command_int(self, command: int, frame: int, x: int, y: int, z: float, *params: float) -> int:
        return self._result(command_int((self.target, 0), command, *params, frame=frame, x=x, y=y, z=z))

    def reposition(self, north_m: float, height_m: float, *params: float) -> int:
        """Send DO_REPOSITION to a position north of the start; by default it may change the mode."""
        x, y = round((LAT_DEG + north_m / 111_195) * 1e7), round(LON_DEG * 1e7)
        frame = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
        return self.command_int(mavlink.MAV_CMD_DO_REPOSITION, frame, x, y, height_m, *(params or (-1, 1)))

    def set_mode(self, name: str) -> int:
        kind = self.fleet.scenario.vehicles[self.fleet.sysids.index(self.target)].kind
        return self.command(mavlink.MAV_CMD_DO_SET_MODE, 1, MODES[kind][name])

    def arm(self) -> int:
        return self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)

    def stream(self, *message_ids: int, hz: float = 4.0) -> None:
        for message_id in message_ids:
            assert self.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, 1e6 / hz) == 0

    def item_message(self, seq: int, fields: dict[str, Any], kind: int = MISSION) -> Any:
        return plan_item(fields).message((self.target, 0), seq, kind)

    def count(self, count: int) -> list[Any]:
        return self.send(mavlink.MAVLink_mission_count_message(self.target, 0, count, 0))

    def set_current(self, seq: int) -> list[Any]:
        """Send MISSION_SET_CURRENT; return the immediate answers."""
        return self.send(mavlink.MAVLink_mission_set_current_message(self.target, 1, seq))

    def upload(self, items: Sequence[dict[str, Any]], kind: int = MISSION) -> int:
        """Upload items, each requested once and in order; return the type of the acknowledgement."""
        queue: list[Any] = []
        exchange = UploadPlan(
            queue.append, (self.target, 0), [plan_item(f) for f in items], kind, sysid=self.codec.srcSystem
        )
        exchange.begin(self.now)
        while queue:
            for message in self.send(queue.pop()):
                exchange.receive(message, self.now)
        assert [seq for _, seq in exchange.requests] == [*range(len(exchange.requests))]
        assert exchange.outcome is not None
        return int(exchange.outcome.message.type)

    def download(self, kind: int = MISSION) -> list[Any]:
        replies = self.send(mavlink.MAVLink_mission_request_list_message(self.target, 0, kind))
        (count,) = [m.count for m in replies if m.get_type() == "MISSION_COUNT"]
        items = []
        for seq in range(count):
            replies = self.send(mavlink.MAVLink_mission_request_int_message(self.target, 0, seq, kind))
            items += [m for m in replies if m.get_type() == "MISSION_ITEM_INT"]
        self.send(mavlink.MAVLink_mission_ack_message(self.target, 0, 0, kind))
        return items

    def ask(self, message_id: int) -> Any:
        """Request a message and return it; a PX4 denies a message that it has just streamed."""
        replies = self.send(command_long((self.target, 0), mavlink.MAV_CMD_REQUEST_MESSAGE, message_id))
        answers = [m for m in replies if m.get_msgId() == message_id]
        streamed = [m for m in self.received if m.get_msgId() == message_id]
        return (answers or streamed)[-1]

    def set_parameter(self, name: str, value: float) -> Any:
        """Send PARAM_SET; return the PARAM_VALUE."""
        return self._set(name, value, mavlink.MAV_PARAM_TYPE_REAL32)

    def _set(self, name: str, field: float, kind: int) -> Any:
        replies = self.send(mavlink.MAVLink_param_set_message(self.target, 1, name.encode(), field, kind))
        (answer,) = [m for m in replies if m.get_type() == "PARAM_VALUE"]
        return answer

    def parameter(self, name: str) -> float:
        request = mavlink.MAVLink_param_request_read_message(self.target, 0, name.encode(), -1)
        (answer,) = [m for m in self.send(request) if m.get_type() == "PARAM_VALUE"]
        return float(answer.param_value)

    def beat(self) -> None:
        """Send a heartbeat."""
        self.send(heartbeat())

    def hold(self, message: Any, seconds: float) -> None:
        """Send a set-point at 10 Hz."""
        for _ in range(round(seconds * 10)):
            self.send(message)
            self.wait(0.1)

    def highest_m(self) -> float:
        """Return the greatest height until the vehicle is disarmed [m]."""
        heights_m = [self.height_m]
        while self.armed:
            self.wait(0.5)
            heights_m.append(self.height_m)
        return max(heights_m)

    def inject(self, fault: str) -> None:
        self.fleet.inject(parse_fault(fault), self.now)

    # -- state --------------------------------------------------------------------------------------------

    @property
    def reached(self) -> list[int]:
        """The indices of the items reported as reached."""
        return [m.seq for m in self.of("MISSION_ITEM_REACHED")]

    @property
    def current(self) -> int:
        """The index of the current item."""
        return int(self.ask(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT).seq)

    def of(self, kind: str) -> list[Any]:
        return [m for m in self.received if m.get_type() == kind]

    def texts(self) -> list[str]:
        return joined_texts(self.of("STATUSTEXT"))

    def heartbeat(self) -> Any:
        return self.ask(mavlink.MAVLINK_MSG_ID_HEARTBEAT)

    @property
    def height_m(self) -> float:
        return float(self.fleet.truth().height_m[0])

    @property
    def speed_m_s(self) -> float:
        return float(self.fleet.truth().speed_m_s[0])

    @property
    def velocity_m_s(self) -> tuple[float, float, float]:
        """The reported velocity: north, east, up."""
        message = self.ask(mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT)
        return message.vx / 100, message.vy / 100, -message.vz / 100

    @property
    def prearm_ok(self) -> bool:
        health = self.ask(mavlink.MAVLINK_MSG_ID_SYS_STATUS).onboard_control_sensors_health
        return bool(health & mavlink.MAV_SYS_STATUS_PREARM_CHECK)

    @property
    def armed(self) -> bool:
        return bool(self.fleet.truth().armed[0])

    @property
    def mode(self) -> str:
        return self.fleet.truth().mode[0]

    def fly(self, height_m: float = 20.0) -> None:
        """Take off in GUIDED to a height."""
        assert self.set_mode("GUIDED") == 0
        assert self.arm() == 0
        assert self.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, height_m) == 0
        self.until(lambda: abs(self.height_m - height_m) < 0.3, 60)

    def fly_mission(self, items: Sequence[dict[str, Any]]) -> None:
        """Upload with a home placeholder, arm in GUIDED, start."""
        assert self.upload([home_item(), *items]) == 0
        assert self.set_mode("GUIDED") == 0
        assert self.arm() == 0
        assert self.command(mavlink.MAV_CMD_MISSION_START) == 0

    def fly_plane_mission(self, items: Sequence[dict[str, Any]]) -> None:
        """Upload to an ArduPlane, select AUTO, arm."""
        assert self.upload(items) == 0
        assert self.set_mode("AUTO") == 0
        assert self.arm() == 0


def station_of(*arguments: Any, **options: Any) -> Station:
    """Return a station of the vehicle of `fleet_of`."""
    return Station(fleet_of(*arguments, **options))


def airborne_plane(params: dict[str, float] | None = None, *, up_m: float = 45.0, **extra: Any) -> Station:
    """Return a station of an ArduPlane in TAKEOFF, above a height."""
    station = station_of("plane", params, **extra)
    assert station.set_mode("TAKEOFF") == 0
    assert station.arm() == 0
    station.until(lambda: station.height_m > up_m, 120)
    return station


def acks(messages: Sequence[Any]) -> list[int]:
    return [m.type for m in messages if m.get_type() == "MISSION_ACK"]


LOCAL, OFFSET = mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_LOCAL_OFFSET_NED
BODY, BODY_OFFSET = mavlink.MAV_FRAME_BODY_NED, mavlink.MAV_FRAME_BODY_OFFSET_NED
BODY_FRD = mavlink.MAV_FRAME_BODY_FRD
Axes = Sequence[float | None]
NONE: Axes = (None, None, None)


def setpoint(
    position: Axes = NONE,
    velocity: Axes = NONE,
    acceleration: Axes = NONE,
    *,
    yaw: float | None = None,
    frame: int = LOCAL,
    force: bool = False,
) -> Any:
    """North, east, down, or a global position of 1e-7 deg and m; None: ignored in the type mask."""
    values = [*position, *velocity, *acceleration, yaw, None]
    bits = [*range(9), 10, 11]
    mask = sum(1 << bit for bit, value in zip(bits, values, strict=True) if value is None)
    fields = frame, mask | (0x200 if force else 0), *(value or 0 for value in values)
    if frame in (LOCAL, OFFSET, BODY, BODY_OFFSET, BODY_FRD):
        return mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, *fields)
    return mavlink.MAVLink_set_position_target_global_int_message(0, 1, 1, *fields)
