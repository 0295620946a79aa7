"""The exchanges for each step of a script, by autopilot."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.personalities import Personality, personality_of
from sim_vehicle.scenarios.model import VehicleSpec
from sim_vehicle.scenarios.plan import PlanWriter, mavlink_number
from sim_vehicle.scenarios.steps import GoTo, ScriptStep
from sim_vehicle.station.exchanges import (
    ChangeMode,
    Command,
    Exchange,
    Send,
    SetParameter,
    UploadPlan,
    WaitUntilReady,
)
from sim_vehicle.station.messages import command_int, command_long
from sim_vehicle.vehicle.behaviour import Behaviour

NAN = float("nan")
READY_WAIT_SHARE = 0.5  # longest wait for readiness, as a share of the step's time
# Step of one command -> the command and its parameters.
COMMANDS = {
    "arm": (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0),
    "disarm": (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0),
    "rtl": (mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH,),
    "land": (mavlink.MAV_CMD_NAV_LAND, 0.0, 0.0, 0.0, NAN, NAN, NAN, NAN),
    "reboot": (mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1.0),
}


class StepExchanges:
    """The exchanges with one vehicle; `send` packs and sends a message to the vehicle."""

    def __init__(self, spec: VehicleSpec, send: Send) -> None:
        self._spec, self._send = spec, send
        self._target = spec.sysid, mavlink.MAV_COMP_ID_AUTOPILOT1
        self._personality: Personality = personality_of(spec.personality, spec.kind)
        # PX4's altitudes in commands are above mean sea level in every frame.
        self._altitudes_amsl = self._personality.identity.autopilot == mavlink.MAV_AUTOPILOT_PX4
        self._writer = PlanWriter(spec.lat_deg, spec.lon_deg)

    def exchanges(self, step: ScriptStep) -> list[Exchange]:
        """Return the exchanges of a step. An exchange begins after the success of the previous exchange."""
        chosen = step.chosen
        if chosen == "fly_mission":
            return [self._mission(), *self._start(step.timeout_s)]
        if chosen == "upload_mission":
            return [self._mission()]
        if chosen == "upload_fence":
            items = self._writer.fence(self._spec.fence)
            return [UploadPlan(self._send, self._target, items, mavlink.MAV_MISSION_TYPE_FENCE)]
        if chosen == "start_mission":
            return self._start(step.timeout_s)
        if step.takeoff is not None:
            return self._takeoff(step.takeoff, step.timeout_s)
        if step.mode is not None:
            return [ChangeMode(self._send, self._target, self.mode_number(step.mode))]
        if step.goto is not None:
            return [self._reposition(step.goto)]
        if step.param is not None:
            return [self._parameter(name, value) for name, value in step.param.items()]
        if step.arm is not None and step.expect == "accepted":
            return self._wait_and_arm(step.timeout_s)
        if step.command is not None:
            number = mavlink_number("MAV_CMD_", step.command.command)
            return [self._long_command(number, *step.command.params)]
        command, *params = COMMANDS[chosen]
        return [self._long_command(int(command), *params)]

    def mode_number(self, name: str) -> int:
        """Return the number of a mode; of alternatives, such as `RTL|Return`, the first that exists."""
        numbers = {mode.name.casefold(): mode.number for mode in self._personality.modes.by_number.values()}
        return next(numbers[wanted] for wanted in name.casefold().split("|") if wanted in numbers)

    def _long_command(self, command: int, *params: float) -> Exchange:
        return Command(self._send, command_long(self._target, command, *params))

    def _reposition(self, goal: GoTo) -> Exchange:
        frame, z = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, goal.height_m
        if self._altitudes_amsl:
            frame, z = mavlink.MAV_FRAME_GLOBAL, goal.height_m + self._spec.alt_amsl_m
        params = (-1.0, float(mavlink.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE), 0.0, NAN)
        x, y = self._writer.place(goal.east_m, goal.north_m)
        command = mavlink.MAV_CMD_DO_REPOSITION
        return Command(self._send, command_int(self._target, command, *params, frame=frame, x=x, y=y, z=z))

    def _mode_for(self, behaviour: Behaviour) -> Exchange:
        return ChangeMode(self._send, self._target, self._personality.modes.of(behaviour).number)

    def _mission(self) -> Exchange:
        items = self._writer.mission(self._spec.mission, home_first=self._personality.mission.home_item)
        return UploadPlan(self._send, self._target, items, mavlink.MAV_MISSION_TYPE_MISSION)

    def _wait_and_arm(self, timeout_s: float) -> list[Exchange]:
        arm = self._long_command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
        return [WaitUntilReady(self._send, self._target, READY_WAIT_SHARE * timeout_s), arm]

    def _start(self, timeout_s: float) -> list[Exchange]:
        arm = self._wait_and_arm(timeout_s)
        if self._personality.modes.of(Behaviour.MISSION).armable:
            return [self._mode_for(Behaviour.MISSION), *arm]
        # ArduCopter refuses arming in AUTO, and needs a start command to take off.
        return [self._mode_for(Behaviour.GUIDED), *arm, self._long_command(mavlink.MAV_CMD_MISSION_START)]

    def _takeoff(self, height_m: float, timeout_s: float) -> list[Exchange]:
        arm = self._wait_and_arm(timeout_s)
        if self._altitudes_amsl:
            params = (NAN, 0.0, 0.0, NAN, NAN, NAN, self._spec.alt_amsl_m + height_m)
            return [*arm, self._long_command(mavlink.MAV_CMD_NAV_TAKEOFF, *params)]
        if self._personality.identity.plane:
            return [self._parameter("TKOFF_ALT", height_m), self._mode_for(Behaviour.TAKEOFF), *arm]
        takeoff = self._long_command(mavlink.MAV_CMD_NAV_TAKEOFF, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, height_m)
        return [self._mode_for(Behaviour.GUIDED), *arm, takeoff]

    def _parameter(self, name: str, value: float) -> Exchange:
        byte_wise = self._personality.parameters.byte_wise
        return SetParameter(self._send, self._target, name, value, byte_wise=byte_wise)
