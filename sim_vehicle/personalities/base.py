"""`Personality`: the differences between autopilots.

Each personality converts its own parameters to `FlightParameters` in SI units.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from sim_vehicle.files.filesystem import FileSystem
from sim_vehicle.files.ftp_rules import FtpRules
from sim_vehicle.files.log_transfer import LogRules
from sim_vehicle.files.logs.record import FlightLog
from sim_vehicle.files.logs.recorder import FlightRecorder
from sim_vehicle.vehicle.behaviour import Behaviour, ModeTable
from sim_vehicle.vehicle.flight_parameters import FailsafeAction, FlightParameters
from sim_vehicle.vehicle.interface import CommandHandler, OneShotMessage, RemoteInput, Vehicle
from sim_vehicle.vehicle.mission import Item, Mission
from sim_vehicle.vehicle.params import Parameters, ParameterTable
from sim_vehicle.vehicle.setpoint_target import Target


@dataclass(frozen=True, slots=True)
class Identity:
    """The autopilot on the link; versions as on the wire: `publish`, `one_shot_messages`, `storage`."""

    autopilot: int  # MAV_AUTOPILOT
    vehicle_type: int  # MAV_TYPE
    plane: bool
    flight_sw_version: int
    capabilities: int
    banner: tuple[str, ...]  # name and version first
    boot_text: tuple[bytes, ...] = ()  # plain bytes on the link at each boot


@dataclass(frozen=True, slots=True)
class ArmingRules:
    """Arming and disarming: `arming`."""

    refusals: Callable[[Vehicle, float], list[str]]  # reasons against arming now
    stick_refusals: Callable[[Vehicle, float], list[str]]  # reasons against arming by the sticks
    # reasons against an arming by force, which skips the other checks
    mandatory_refusals: Callable[[Vehicle, float], list[str]] = lambda _vehicle, _now: []
    # the end of a landing disarms; False: after a flight only `disarm_landed_s` disarms, and not in a mission
    landing_disarms: bool = True
    flight_counter: str | None = None  # name of the parameter that counts flights


@dataclass(frozen=True, slots=True)
class CommandRules:
    """COMMAND_LONG and COMMAND_INT, and the targets of all messages: `commands`."""

    handlers: Mapping[int, CommandHandler]  # by MAV_CMD; every other command is UNSUPPORTED
    # (own system id, message to this system or to all systems) -> True if the message is processed
    is_addressed: Callable[[int, Any], bool]
    refuses_foreign: bool = False  # answers a command to another system or component with FAILED


@dataclass(frozen=True, slots=True)
class MessageRules:
    """Received messages except HEARTBEAT, and messages on request: `receivers`, `one_shot_messages`."""

    # message type -> handler (vehicle, message, time [s]); messages without a handler are ignored
    receivers: Mapping[str, Callable[[Vehicle, Any, float], None]]
    one_shot: Mapping[int, OneShotMessage]  # message id -> messages to send


@dataclass(frozen=True, slots=True)
class SetpointRules:
    """SET_POSITION_TARGET_LOCAL_NED and SET_POSITION_TARGET_GLOBAL_INT: `setpoints`."""

    # the target of a message; None: the message changes nothing
    read: Callable[[Vehicle, Any], Target | None]
    resumes: bool = False  # set-points that return after a loss restore the mode that needs them


@dataclass(frozen=True, slots=True)
class TelemetryRules:
    """Texts and streamed messages: `sender`, `streams`, `publish`."""

    texts: Mapping[str, tuple[int, str]]  # event -> (MAV_SEVERITY, template); other events have no text
    streams: Mapping[int, tuple[int, ...]]  # MAV_DATA_STREAM -> message ids
    default_rates_hz: Mapping[int, float]  # message id -> default rate
    unsupported: frozenset[int]  # messages of telemetry.STREAMS that this autopilot does not send
    # (global target, local target) reported in the present mode
    targets: Callable[[Vehicle], tuple[bool, bool]]
    mission_state: bool = True  # False: mission_state and mission_mode are always 0
    empty_mission_total: int = 0  # MISSION_CURRENT.total with no mission
    active_when_armed: bool = False  # MAV_STATE_ACTIVE when armed on the ground, CRITICAL only if armed
    gps_fix_type: int = 6  # GPS_FIX_TYPE of the autopilot's own simulator
    gps_present_with_fix: bool = False  # SYS_STATUS lists GPS as present only with a fix


@dataclass(frozen=True, slots=True)
class MissionRules:
    """The mission, its transfer and its landing."""

    make: type[Mission]
    transfer: Callable[[Vehicle], Any]  # the vehicle's side of the mission protocol
    store_item: Callable[[Item], Item | int]  # stored item, or MAV_MISSION_RESULT
    home_item: bool  # item 0 of a mission is home
    # a landing does not end the mission, and disarming in the mission keeps the index
    stays_landed: bool = False
    ends_in: Behaviour | None = None  # behaviour after a mission that ends in the air
    # starts the landing of the mission, returns False if impossible; None: the autopilot has a mode for it
    start_landing: Callable[[Vehicle, float], bool] | None = None
    # returns the mission items that a return flies, and the altitude of the climb before them [m above mean
    # sea level]; returns None for a return to home or a rally point
    return_by_mission: Callable[[Vehicle], tuple[Sequence[Item], float] | None] = lambda _vehicle: None


@dataclass(frozen=True, slots=True)
class HomeRules:
    """Home and the origin of local coordinates: `home_and_rally`."""

    with_position: bool = False  # home is set with the position estimate, not before
    is_local: bool = False  # HOME_POSITION also has local coordinates


@dataclass(frozen=True, slots=True)
class FailsafeRules:
    """Failsafes and the fence: `failsafe`, `battery_watch`, `fence_watch`."""

    disarms: bool = False  # a failsafe on the ground stops the motors (FailsafeAction.WARN does not)
    # custom_mode of the actions without a Behaviour
    modes: Mapping[FailsafeAction, int] = field(default_factory=dict)
    battery_latches: bool = False  # checks the battery only while armed; a failsafe lasts until a reboot
    fence_limits_latch: bool = False  # only limits that were set when the fence was enabled are enforced


@dataclass(frozen=True, slots=True)
class StorageRules:
    """Flight logs, and the files of ground stations: `storage`."""

    new_log: Callable[[], FlightLog]  # an empty log in the autopilot's format
    files: Callable[[Vehicle, FlightRecorder], FileSystem]  # the file tree, which can include the logs
    ftp: FtpRules
    logs: LogRules


@dataclass(frozen=True, slots=True)
class Personality:
    """One autopilot's data for one kind of airframe: a record for each part of the vehicle."""

    identity: Identity
    parameters: ParameterTable
    flight_parameters: Callable[[Parameters], FlightParameters]
    modes: ModeTable
    arming: ArmingRules
    commands: CommandRules
    messages: MessageRules
    telemetry: TelemetryRules
    mission: MissionRules
    remote: Callable[[Vehicle], RemoteInput]
    storage: StorageRules
    setpoints: SetpointRules
    ready_s: float  # time from boot to a position estimate
    home: HomeRules = HomeRules()
    failsafes: FailsafeRules = FailsafeRules()
