"""A small ArduCopter for tests, written from the notes on the real one and independent of `sim_vehicle`.

Bytes in, bytes out, virtual time. Its upload is not atomic: the copter flies the present content of its list.
The copter repeats MISSION_REQUEST every second and ends an upload after eight requests. It answers duplicates
with INVALID_SEQUENCE and a repeated last item with ERROR.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import cos, hypot, radians

from pymavlink.dialects.v20 import ardupilotmega as mavlink

MODES = {0: "STABILIZE", 3: "AUTO", 4: "GUIDED", 5: "LOITER", 6: "RTL", 9: "LAND"}
PREARM = mavlink.MAV_SYS_STATUS_PREARM_CHECK
HOME = (46.0490, 14.5060)
ACK = mavlink.MAVLink_mission_ack_message


@dataclass
class Script:
    """Faults and peculiarities of a vehicle."""

    boot_s: float = 2.0
    """time until which a set mode is undone"""
    ready_at_s: float = 5.0
    refuse_arming: str = ""
    late_texts: bool = False
    """the copter sends its texts after its acknowledgements"""
    refuse_mode: str = ""
    refuse_set_current: bool = False
    refuse_item: int | None = None
    """MISSION_ACK INVALID for this item, once for each entry of `refusals_left`"""
    refusals_left: int = 1
    partial_lists: bool = True
    """support of MISSION_WRITE_PARTIAL_LIST"""
    stays_on_ground: bool = False
    never_moves: bool = False
    heartbeats_unasked_only: bool = False
    """a heartbeat every second, but none in answer to MAV_CMD_REQUEST_MESSAGE"""
    spoil_item: int | None = None
    """an item that is stored 500 m off, without an error"""
    rally_points: int | None = 0
    """None: firmware without rally points"""
    speeds: bool = True
    """support of MAV_CMD_DO_CHANGE_SPEED"""


@dataclass
class Transfer:
    count: int
    asked: int = 0
    last_item_s: float = 0.0
    next_ask_s: float = 0.0


@dataclass
class Copter:
    sysid: int = 1
    script: Script = field(default_factory=Script)
    autopilot: int = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
    capabilities: int = mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT

    def __post_init__(self) -> None:
        self.mav = mavlink.MAVLink(None, srcSystem=self.sysid, srcComponent=1)
        self.mav.robust_parsing = True
        self.mission: list[tuple] = []
        self.uid2 = b"sim_vehicle\0" + bytes(6)
        self.position = list(HOME)
        self.commands: list[tuple[int, tuple[float, ...]]] = []
        self.acks_received: list[int] = []
        self.boot(0.0)

    def boot(self, now: float) -> None:
        self.booted, self.now = now, now
        self.mode, self.armed, self.seq, self.alt = 0, False, 0, 0.0
        self.streams: dict[int, float] = {}
        self.due: dict[int, float] = {0: now}
        self.transfer: Transfer | None = None
        self.moved = 0.0
        self.out: list[bytes] = []
        self.later: list = []

    @property
    def mode_name(self) -> str:
        return MODES[self.mode]

    @property
    def flies(self) -> bool:
        return self.armed and self.alt > 0.2

    @property
    def landed_state(self) -> int:
        lands = self.mode_name == "AUTO" and self.seq < len(self.mission) and self.mission[self.seq][0] == 21
        return (4 if lands and not self.moved else 2) if self.flies else 1

    # in

    def receive(self, data: bytes, now: float) -> list[bytes]:
        self.now = now
        for message in self.mav.parse_buffer(data) or []:
            handler = getattr(self, "on_" + message.get_type().lower(), None)
            if handler is not None and getattr(message, "target_system", self.sysid) in (0, self.sysid):
                handler(message)
        return self.take()

    def on_command_long(self, m) -> None:
        params = (m.param1, m.param2, m.param3, m.param4, m.param5, m.param6, m.param7)
        self.commands.append((m.command, params))
        do = {400: self.arm, 176: self.set_mode, 300: self.start, 224: self.set_current}.get(m.command)
        if m.command == 178 and self.script.speeds:
            do = lambda *_: 0  # noqa: E731
        if m.command == 511:
            self.streams[int(m.param1)] = m.param2 / 1e6
            self.due[int(m.param1)] = self.now
            do = lambda *_: 0  # noqa: E731
        elif m.command == 512 and m.param1 == 0:
            do = lambda *_: 3 if self.script.heartbeats_unasked_only else self.telemeter(0) or 0  # noqa: E731
        elif m.command == 512:
            self.send(
                mavlink.MAVLink_autopilot_version_message(
                    self.capabilities,
                    0x04060200,
                    0,
                    0,
                    0,
                    bytes(8),
                    bytes(8),
                    bytes(8),
                    0,
                    0,
                    0,
                    self.uid2.ljust(18, b"\0"),
                )
            )
            do = lambda *_: 0  # noqa: E731
        result = 3 if do is None else do(*params)
        self.send(mavlink.MAVLink_command_ack_message(m.command, result, 0, 0, 255, 190))

    def arm(self, p1, p2, *_) -> int:
        assert p2 == 0.0
        if p1 == 0.0:
            self.armed = self.armed and self.flies
            return 4 if self.armed else 0
        if self.script.refuse_arming or self.now - self.booted < self.script.ready_at_s:
            for _ in range(3):  # as a PX4 repeats its text
                self.text(2, f"Arm: {self.script.refuse_arming or 'Need Position Estimate'}")
            return 4
        if self.mode_name == "AUTO":
            self.text(2, "Arm: AUTO mode not armable")
            return 4
        self.armed = True
        return 0

    def set_mode(self, p1, p2, *_) -> int:
        if MODES.get(int(p2)) == self.script.refuse_mode:
            self.text(2, f"Mode change to {self.script.refuse_mode} failed: init failed")
            return 4
        if self.now - self.booted >= self.script.boot_s:
            self.mode = int(p2)
        return 0

    def start(self, *_) -> int:
        if len(self.mission) < 2:
            return 4
        self.mode, self.seq = 3, 1
        return 0

    def set_current(self, p1, *_) -> int:
        if self.script.refuse_set_current or not 0 <= p1 < len(self.mission):
            return 2
        self.seq = int(p1)
        return 0

    def on_mission_count(self, m) -> None:
        self.transfer = Transfer(m.count, 0, self.now, self.now)
        del self.mission[m.count :]
        self.ask()

    def on_mission_write_partial_list(self, m) -> None:
        if not self.script.partial_lists:
            return
        if not 0 <= m.start_index <= m.end_index <= len(self.mission):
            self.send(ACK(255, 190, 1, 0))
            return
        self.transfer = Transfer(m.end_index + 1, m.start_index, self.now, self.now)
        self.ask()

    def on_mission_item_int(self, m) -> None:
        t = self.transfer
        if t is None:
            self.send(ACK(255, 190, 1, 0))
            return
        if m.seq != t.asked:
            self.send(ACK(255, 190, 13, 0))
            return
        if m.seq == self.script.refuse_item and self.script.refusals_left > 0:
            self.script.refusals_left -= 1
            self.transfer = None
            self.send(ACK(255, 190, 5, 0))
            return
        x = m.x + 50_000 if m.seq == self.script.spoil_item else m.x
        item = (m.command, m.frame, x, m.y, int(m.z * 100) / 100, int(m.param1), 0.0, 0.0, 0.0)
        if m.seq == 0:
            item = (16, 0, int(HOME[0] * 1e7), int(HOME[1] * 1e7), 300.0, 0, 0.0, 0.0, 0.0)
        self.mission[m.seq : m.seq + 1] = [item]
        t.asked, t.last_item_s = t.asked + 1, self.now
        if t.asked == t.count:
            self.transfer = None
            self.send(ACK(255, 190, 0, 0))
        else:
            self.ask()

    def ask(self) -> None:
        self.transfer.next_ask_s = self.now + 1.0
        self.send(mavlink.MAVLink_mission_request_message(255, 190, self.transfer.asked, 0))

    def on_mission_request_list(self, m) -> None:
        if m.mission_type != 0:
            points = self.script.rally_points if m.mission_type == 2 else None
            if points is None:
                self.send(ACK(255, 190, 3, m.mission_type))
            else:
                self.send(mavlink.MAVLink_mission_count_message(255, 190, points, m.mission_type))
        elif self.transfer is not None:
            self.send(ACK(255, 190, 14, 0))
        else:
            self.send(mavlink.MAVLink_mission_count_message(255, 190, len(self.mission), 0))

    def on_mission_request_int(self, m) -> None:
        if self.transfer is None and m.seq < len(self.mission):
            c, f, x, y, z, *p = self.mission[m.seq]
            self.send(mavlink.MAVLink_mission_item_int_message(255, 190, m.seq, f, c, 0, 1, *p, x, y, z, 0))

    def on_mission_ack(self, m) -> None:
        self.acks_received.append(m.type)

    # time

    def step(self, now: float) -> list[bytes]:
        dt, self.now = now - self.now, now
        self.fly(dt)
        while self.later:
            self.send(self.later.pop(0))
        t = self.transfer
        if t is not None and now - t.last_item_s >= 8.0:
            self.transfer = None
            self.send(ACK(255, 190, 15, 0))
            self.text(4, "Mission upload timeout")
        elif t is not None and now >= t.next_ask_s:
            self.ask()
        for msgid, due in list(self.due.items()):
            if now >= due:
                self.due[msgid] = now + (1.0 if msgid == 0 else self.streams[msgid])
                self.telemeter(msgid)
        return self.take()

    def fly(self, dt: float) -> None:
        self.moved = 0.0
        if not self.armed or self.mode_name != "AUTO" or self.script.stays_on_ground:
            return
        if not 0 < self.seq < len(self.mission):
            return
        command, _, x, y, z, *_ = self.mission[self.seq]
        if command == 22:
            self.alt = min(z, self.alt + 3.0 * dt)
            self.seq += self.alt >= z
            return
        if self.script.never_moves:
            return
        north = (x / 1e7 - self.position[0]) * 111_000
        east = (y / 1e7 - self.position[1]) * 111_000 * cos(radians(HOME[0]))
        gap = hypot(north, east)
        if gap > 2.0:
            self.moved = min(gap, 10.0 * dt)
            for i in (0, 1):
                self.position[i] += ((x, y)[i] / 1e7 - self.position[i]) * self.moved / gap
        elif command == 21:
            self.alt = max(0.0, self.alt - 2.0 * dt)
            self.armed = self.alt > 0
        else:
            self.seq += 1

    def telemeter(self, msgid: int) -> None:
        ms = int((self.now - self.booted) * 1000)
        ready = self.now - self.booted >= self.script.ready_at_s
        lat, lon = (int(p * 1e7) for p in self.position)
        build = {
            0: lambda: mavlink.MAVLink_heartbeat_message(
                2, self.autopilot, 81 | 128 * self.armed, self.mode, 3, 3
            ),
            33: lambda: mavlink.MAVLink_global_position_int_message(
                ms, lat, lon, 300_000, int(self.alt * 1000), 1000 if self.moved else 0, 0, 0, 9000
            ),
            1: lambda: mavlink.MAVLink_sys_status_message(
                PREARM, PREARM, PREARM * ready, 0, 12_000, 0, 90, 0, 0, 0, 0, 0, 0
            ),
            193: lambda: mavlink.MAVLink_ekf_status_report_message(16 * ready, 0, 0, 0, 0, 0),
            245: lambda: mavlink.MAVLink_extended_sys_state_message(0, self.landed_state),
            42: lambda: mavlink.MAVLink_mission_current_message(
                self.seq, max(0, len(self.mission) - 1), 3, 1
            ),
            242: lambda: mavlink.MAVLink_home_position_message(
                lat, lon, 300_000, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0
            ),
        }[msgid]
        self.send(build())

    # out

    def text(self, severity: int, text: str) -> None:
        message = mavlink.MAVLink_statustext_message(severity, text.encode())
        if self.script.late_texts:
            self.later.append(message)
        else:
            self.send(message)

    def send(self, message) -> None:
        self.out.append(message.pack(self.mav))
        self.mav.seq = (self.mav.seq + 1) % 256

    def take(self) -> list[bytes]:
        out, self.out = self.out, []
        return out
