"""MAVSDK at one end of a UDP link and `python -m sim_vehicle` at the other; every wait has a time-out.

One simulator serves many tests; each uses untouched vehicles. Tests of ArduPilot and PX4 run in parallel,
because they mostly wait.
"""

import json
import math
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from functools import cached_property, wraps
from typing import Any, TypeVar

import pytest
from mavsdk import Autopilot, ComponentType, Configuration, ConnectionResult, Mavsdk
from mavsdk.exceptions import MavsdkError
from mavsdk.plugins.action import Action
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkMessage
from mavsdk.plugins.mission_raw import MissionRaw
from mavsdk.plugins.telemetry import FlightMode, Telemetry
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from simulator_process import LIMIT_S, free_udp_port, simulator

FLIGHT_S = 60.0
AUTOPILOTS = {"ardupilot": Autopilot.ARDUPILOT, "px4": Autopilot.PX4}
Plugin = TypeVar("Plugin")
METRES_PER_DEGREE = 111_195.0
# Fast copters, patient with a ground station whose clock is much slower than theirs.
COPTERS = (
    "--ready-s", "0", "--param", "DISARM_DELAY=0", "--param", "COM_DISARM_PRFLT=-1",
    "--param", "COM_OF_LOSS_T=5", "--param", "GUID_TIMEOUT=5", "--param", "COM_FAIL_ACT_T=1",
    "--param", "LAND_SPEED=150", "--param", "WPNAV_SPEED_DN=300", "--param", "RTL_LOIT_TIME=0",
    "--param", "MPC_LAND_SPEED=1.5", "--param", "MPC_Z_VEL_MAX_DN=3", "--param", "MPC_Z_V_AUTO_DN=3",
    "--param", "MPC_TKO_SPEED=3", "--param", "RTL_RETURN_ALT=15",
)  # fmt: skip
ARDUPILOT_RATES = ("health", "home", "in_air", "position", "velocity_ned", "attitude_euler")


class Vehicle:
    """A system of MAVSDK and its plug-ins; `until` evaluates its condition at each telemetry update."""

    def __init__(self, system: Any, personality: str) -> None:
        self.system, self.personality = system, personality
        self._plugins: list[Any] = []
        self.telemetry = self.plugin(Telemetry)
        self.texts: list[str] = []
        self._update = threading.Event()
        self.telemetry.subscribe_armed(self._on_update, None)
        self.telemetry.subscribe_position(self._on_update, None)
        self.telemetry.subscribe_status_text(self._on_text, None)

    def plugin(self, kind: Callable[[Any], Plugin]) -> Plugin:
        """Return a new plug-in, kept as long as MAVSDK, because an early collection crashed its threads."""
        made = kind(self.system)
        self._plugins.append(made)
        return made

    @cached_property
    def action(self) -> Action:
        return self.plugin(Action)

    @cached_property
    def mission_raw(self) -> MissionRaw:
        return self.plugin(MissionRaw)

    @cached_property
    def direct(self) -> MavlinkDirect:
        return self.plugin(MavlinkDirect)

    @property
    def px4(self) -> bool:
        return self.personality == "px4"

    def _on_update(self, _value: Any, _user_data: Any) -> None:
        self._update.set()

    def _on_text(self, text: Any, _user_data: Any) -> None:
        self.texts.append(text.text)

    # -- actions -------------------------------------------------------------------------------------------

    def until(self, condition: Callable[[], Any], what: str, limit_s: float = FLIGHT_S) -> None:
        end_s = time.monotonic() + limit_s
        self._update.clear()
        while not condition():
            # No lock is held: a condition may call MAVSDK, which answers in the callbacks' thread.
            left_s = end_s - time.monotonic()
            updated = left_s > 0 and self._update.wait(left_s)
            assert updated, f"{what}: not within {limit_s} s; mode {self.mode.name}, texts {self.texts[-5:]}"
            self._update.clear()

    def ask_for_telemetry(self) -> None:
        """Request telemetry at 10 Hz.

        ArduPilot streams little by default, and no plug-in requests mission states.
        """
        for what in ARDUPILOT_RATES:
            getattr(self.telemetry, f"set_rate_{what}")(10.0)
        self.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_MISSION_CURRENT, 2e5)

    def command(self, number: int, *params: float) -> None:
        """Send COMMAND_LONG and require its acceptance."""
        fields: dict[str, float] = {f"param{i}": value for i, value in enumerate(params, start=1)}
        fields |= {"command": number, "target_system": self.system.get_system_id(), "target_component": 1}
        message = MavlinkMessage("COMMAND_LONG", fields_json=json.dumps(fields))
        answer = json.loads(self.direct.send_command(message).fields_json)
        assert answer["result"] == mavlink.MAV_RESULT_ACCEPTED, answer

    def ready(self) -> None:
        """Wait until the vehicle can be armed and its position and home are known."""
        telemetry = self.telemetry

        def known() -> bool:
            healthy = telemetry.health_all_ok() and telemetry.health().is_armable
            places = (telemetry.position(), telemetry.home())
            return healthy and all(math.isfinite(place.latitude_deg) for place in places)

        self.until(known, "ready", LIMIT_S)

    def take_off(self, height_m: float) -> None:
        """Arm and climb to a height; on PX4 wait for Hold."""
        self.ready()
        self.action.set_takeoff_altitude(height_m)
        self.action.arm()
        self.action.takeoff()
        self.until(lambda: abs(self.height_m - height_m) < 0.6, f"{height_m} m high")
        if self.px4:
            self.in_mode(FlightMode.HOLD)

    def in_mode(self, mode: FlightMode) -> None:
        self.until(lambda: self.mode == mode, f"mode {mode.name}")

    def disarmed(self) -> None:
        self.until(lambda: not self.telemetry.armed(), "disarmed")

    # -- state ---------------------------------------------------------------------------------------------

    @property
    def mode(self) -> FlightMode:
        return FlightMode(self.telemetry.flight_mode())

    @property
    def height_m(self) -> float:
        return float(self.telemetry.position().relative_altitude_m)

    def offset_m(self) -> tuple[float, float]:
        """Return the position north and east of home [m]."""
        home, here = self.telemetry.home(), self.telemetry.position()
        narrowing = math.cos(math.radians(home.latitude_deg))
        north_deg, east_deg = here.latitude_deg - home.latitude_deg, here.longitude_deg - home.longitude_deg
        return north_deg * METRES_PER_DEGREE, east_deg * METRES_PER_DEGREE * narrowing

    def near(self, north_m: float, east_m: float, within_m: float = 3.0) -> bool:
        """Return True if the vehicle is near a position relative to home."""
        north, east = self.offset_m()
        return math.hypot(north - north_m, east - east_m) < within_m

    def place_deg(self, north_m: float, east_m: float) -> tuple[float, float]:
        """Return latitude and longitude of a position relative to home."""
        home = self.telemetry.home()
        narrowing = math.cos(math.radians(home.latitude_deg))
        return (
            home.latitude_deg + north_m / METRES_PER_DEGREE,
            home.longitude_deg + east_m / (METRES_PER_DEGREE * narrowing),
        )

    @property
    def ground_speed_m_s(self) -> float:
        velocity = self.telemetry.velocity_ned()
        return math.hypot(velocity.north_m_s, velocity.east_m_s)


class MavsdkPeer:
    """MAVSDK, connected to one simulator."""

    def __init__(self, mavsdk: Mavsdk) -> None:
        self._mavsdk = mavsdk
        self._taken: set[int] = set()
        self._vehicles: list[Vehicle] = []  # kept as long as MAVSDK runs
        self._found = threading.Event()
        mavsdk.subscribe_on_new_system(self._on_update, None)

    def _on_update(self, _user_data: Any) -> None:
        self._found.set()

    def take(self, personality: str) -> Vehicle:
        """Return an unused vehicle; request telemetry from an ArduPilot."""
        vehicle = Vehicle(self._untouched(personality), personality)
        self._vehicles.append(vehicle)
        if not vehicle.px4:
            vehicle.ask_for_telemetry()
        return vehicle

    def _untouched(self, personality: str) -> Any:
        end_s = time.monotonic() + LIMIT_S
        while time.monotonic() < end_s:
            self._found.clear()
            for system in self._mavsdk.get_systems():
                number = system.get_system_id()
                if number not in self._taken and system.autopilot_type() == AUTOPILOTS[personality]:
                    self._taken.add(number)
                    return system
            self._found.wait(0.2)  # the heartbeat of a known system may still be missing
        raise AssertionError(f"no {personality} is left; taken: {sorted(self._taken)}")


@contextmanager
def connected(*arguments: str) -> Iterator[MavsdkPeer]:
    """Start a simulator with these arguments and connect MAVSDK to it."""
    port = free_udp_port()
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    assert mavsdk.add_any_connection(f"udpin://127.0.0.1:{port}") == ConnectionResult.SUCCESS
    try:
        with simulator("--no-table", "--url", f"udpout:127.0.0.1:{port}", *arguments):
            peer = MavsdkPeer(mavsdk)
            yield peer
    finally:
        mavsdk.destroy()


def side_by_side(test: Callable[..., None]) -> Callable[..., None]:
    """Run a test for all personalities in parallel; each case reports its own result."""
    ended: dict[str, Future[None]] = {}

    @wraps(test)
    def case(personality: str, **fixtures: Any) -> None:
        if personality not in ended:
            with ThreadPoolExecutor(len(AUTOPILOTS)) as pool:  # ends after all of them
                for each in AUTOPILOTS:
                    ended[each] = pool.submit(test, personality=each, **fixtures)
        ended.pop(personality).result()

    return pytest.mark.parametrize("personality", list(AUTOPILOTS))(case)


def refusal(call: Callable[..., Any], *arguments: Any) -> str:
    """Return the result name of MAVSDK's error."""
    with pytest.raises(MavsdkError) as caught:
        call(*arguments)
    return str(caught.value.result.name)
