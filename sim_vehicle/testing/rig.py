"""A fleet under test and its clock, stepped by the test or by the thread of a server."""

import inspect
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from sim_vehicle.epoch import EPSILON_S
from sim_vehicle.faults.spec import FaultError, parse_fault
from sim_vehicle.fleet import Fleet
from sim_vehicle.personalities import PERSONALITIES
from sim_vehicle.problems import remedy
from sim_vehicle.scenarios import Scenario, ScenarioError, default_scenario, load_scenario
from sim_vehicle.scenarios.file import read_step, validated
from sim_vehicle.scenarios.script import ScriptStation
from sim_vehicle.scenarios.steps import ScriptStep
from sim_vehicle.serving.tlog import tlogs
from sim_vehicle.station.frames import STATION, Receiver, Sender
from sim_vehicle.station.messages import joined_texts
from sim_vehicle.wire.outbox import Frames

if TYPE_CHECKING:
    from sim_vehicle.testing.served import ServerThread

STEP_S = 0.05  # simulated time of one tick of the test's clock
HOME = (46.0490, 14.5060, 300.0)  # latitude, longitude [deg], altitude above mean sea level [m]
PEER = "the test"
MAX_VEHICLES = 10_000
MAX_OPERATOR_LINES = 20
SOURCE_SYSTEM_AT = 5  # index of the source system in a MAVLink 2 frame
Result = TypeVar("Result")


class NotWithinTimeError(AssertionError):
    """A condition that did not hold in time, or a failed action."""


@dataclass(frozen=True, slots=True)
class VehicleTruth:
    """The true state of one vehicle, unknown to ground stations."""

    lat_deg: float
    lon_deg: float
    alt_amsl_m: float
    height_m: float  # above the ground
    speed_m_s: float  # horizontal
    airborne: bool
    armed: bool
    crashed: bool
    battery_remaining: float  # share of the full charge, in [0, 1]
    strikes: int
    mode: str


class Vehicle:
    """One vehicle of the fleet under test."""

    def __init__(self, rig: "Rig", index: int) -> None:
        self._rig, self.index = rig, index
        assert rig.fleet is not None
        self.sysid, self.link = rig.fleet.sysids[index], rig.fleet.links[index]
        self._receiver = Receiver()
        self._raw: list[bytes] = []
        self._log: list[tuple[float, bytes]] = []  # time [s] and data, from and to the vehicle
        self._decoded = 0
        self._received: list[Any] = []

    def __repr__(self) -> str:
        truth = self.truth
        state = "armed" if truth.armed else "disarmed"
        return f"<vehicle {self.sysid}: {truth.mode}, {state}, {truth.height_m:.1f} m high>"

    def send(self, message: Any) -> list[Any]:
        """Send a pymavlink message or bytes as a ground station; return the immediate answers."""
        before = len(self.received)
        self._rig.deliver(message, self)
        return self.received[before:]

    @property
    def received(self) -> list[Any]:
        """Every valid message from this vehicle, in order; a test may remove processed messages."""
        while self._decoded < len(self._raw):
            self._received += self._receiver.messages(self._raw[self._decoded])
            self._decoded += 1
        return self._received

    @property
    def raw(self) -> bytes:
        """Every byte from this vehicle, including boot text."""
        return b"".join(self._raw)

    def messages(self, kind: str) -> list[Any]:
        """Return the received messages of one kind, for example HEARTBEAT."""
        return [message for message in self.received if message.get_type() == kind]

    @property
    def texts(self) -> list[str]:
        """The texts of the vehicle's STATUSTEXT messages, with their chunks joined."""
        return joined_texts(self.messages("STATUSTEXT"))

    @property
    def truth(self) -> VehicleTruth:
        """The vehicle's true state, unknown to ground stations."""
        return self._rig.truth(self.index)

    @property
    def mode(self) -> str:
        """The name of the mode, such as `GUIDED` or `Mission`."""
        return self.truth.mode

    @property
    def armed(self) -> bool:
        """True while the vehicle is armed."""
        return self.truth.armed

    @property
    def height_m(self) -> float:
        """The height above the ground [m]."""
        return self.truth.height_m

    def inject(self, fault: str) -> None:
        """Begin a fault in the form of `--fault`, such as `gps_loss:for=10`; `at` counts from this call.

        Raises FaultError for an invalid fault, and for a fault with its own `sysid`.
        """
        __tracebackhide__ = True
        try:
            self._rig.inject(fault, self.index)
        except FaultError as error:
            raise FaultError(str(error)) from None

    def do(self, action: str, value: Any = None) -> None:
        """Perform one action of a scenario's script: `do("takeoff", 20)`, `do("mode", "RTL")`.

        The action begins after the vehicle's earlier actions, at least 3 s after its first heartbeat. If the
        action fails, the clock raises NotWithinTimeError.
        Raises ScenarioError for an action that is unknown or impossible on this vehicle.
        """
        __tracebackhide__ = True
        try:
            step = read_step(action, value)
        except ScenarioError as error:
            raise ScenarioError(str(error)) from None
        text = self._rig.step_problem(self.index, step)
        if text:
            raise ScenarioError(f"{action}: vehicle {self.sysid} {text}")
        self._rig.do(self.index, step)


Swarm = tuple[Vehicle, ...]  # the vehicles of the fleet under test, in order


class Rig:
    """The fleet of one test; `serving` is set while a thread runs the fleet."""

    def __init__(self, seed: int) -> None:
        self.seed = seed
        self.fleet: Fleet | None = None
        self.vehicles: list[Vehicle] = []
        self.serving: ServerThread | None = None
        self.operator_lines: deque[str] = deque(maxlen=MAX_OPERATOR_LINES)  # output of a server
        self._sender = Sender()
        self._station: ScriptStation | None = None
        self._now = 0.0
        self._ticks = 0

    @property
    def now(self) -> float:
        return self._now if self.serving is None else self.serving.now

    def create(self, scenario: Scenario, ready_s: float | None) -> Swarm:
        __tracebackhide__ = True
        if self.fleet is not None:
            raise RuntimeError("a test has one fleet; create all vehicles by one call of swarm(count=...)")
        self.fleet = Fleet(scenario, ready_s=ready_s)
        self.vehicles = [Vehicle(self, index) for index in range(len(scenario.vehicles))]
        self.take(self.fleet.step(0.0), 0.0)
        return tuple(self.vehicles)

    def existing(self) -> Fleet:
        __tracebackhide__ = True
        if self.fleet is None:
            raise RuntimeError(
                "the test has no vehicle yet; use the fixture `vehicle`, or call swarm() first"
            )
        return self.fleet

    def take(self, frames: Frames, now: float) -> None:
        """Store the frames of the fleet with their vehicles."""
        for index, frame in frames:
            self.vehicles[index]._raw.append(frame)
            self.vehicles[index]._log.append((now, frame))
            if self._station is not None:
                self._station.receive(index, frame, self.now)

    def _call(self, function: Callable[[], Result]) -> Result:
        return function() if self.serving is None else self.serving.call(function)

    def truth(self, index: int) -> VehicleTruth:
        truth = self._call(self.existing().truth)
        values = {field.name: getattr(truth, field.name)[index] for field in fields(VehicleTruth)}
        return VehicleTruth(**{n: v.item() if isinstance(v, np.generic) else v for n, v in values.items()})

    def deliver(self, message: Any, vehicle: Vehicle) -> None:
        fleet = self.existing()
        is_message = not isinstance(message, bytes)
        data = self._sender.pack(message) if is_message else message

        def received() -> None:
            if is_message:
                vehicle._log.append((self.now, data))
            self.take(fleet.receive(data, self.now, peer=PEER, link=vehicle.link), self.now)

        self._call(received)

    def inject(self, fault: str, index: int) -> None:
        __tracebackhide__ = True
        spec = parse_fault(fault)
        if spec.vehicles is not None:
            raise FaultError(
                f"fault {spec.fault}: `vehicle.inject` chooses the vehicle; remove sysid [fault-vehicle]"
            )
        self._call(lambda: self.existing().inject(spec, self.now, [index]))

    def step_problem(self, index: int, step: ScriptStep) -> str:
        scenario = self.existing().scenario
        return scenario.step_problem(step, scenario.vehicles[index])

    def do(self, index: int, step: ScriptStep) -> None:
        self._call(lambda: self._begin(index, step))

    def _begin(self, index: int, step: ScriptStep) -> None:
        if self._station is None:
            self._station = ScriptStation(self.existing().scenario, on_frame=self._log_sent)
            for vehicle in self.vehicles:
                for frame in vehicle._raw:
                    self._station.receive(vehicle.index, frame, self.now)
        self._station.append_step(index, step)

    def _log_sent(self, index: int, frame: bytes, now: float) -> None:
        """Log the messages of the ground station; `take` logs the messages of the vehicle."""
        if frame[SOURCE_SYSTEM_AT] == STATION[0]:
            self.vehicles[index]._log.append((now, frame))

    def write_tlogs(self, folder: Path) -> None:
        """Write a tlog of each vehicle, with the messages from and to the vehicle."""
        if self.fleet is None:
            return
        with tlogs(folder, self.fleet.scenario.vehicles) as record_frame:
            for vehicle in self.vehicles:
                for now, frame in vehicle._log:
                    record_frame(vehicle.index, frame, now)

    def tick(self) -> None:
        """Let 0.05 s pass, or wait briefly for a served fleet; then run the ground station."""
        __tracebackhide__ = True
        if self.serving is not None:
            self.serving.sleep_briefly()
        else:
            self._ticks += 1
            self._now = self._ticks * STEP_S
            if self.fleet is not None:
                self.take(self.fleet.step(self._now), self._now)
        self._call(self._run_station)
        if self._station is not None and self._station.failures:
            failed = self._station.failures.pop(0)
            raise NotWithinTimeError(f"vehicle {failed.sysid}: {failed.action} failed: {failed.text}")

    def _run_station(self) -> None:
        if self._station is None or self.fleet is None:
            return
        for link, data in self._station.step(self.now):
            self.take(self.fleet.receive(data, self.now, peer=self._station, link=link), self.now)

    def state(self) -> str:
        """Return the state and last text of the first 10 vehicles, for a failing test."""
        lines = [
            f"{vehicle!r}; last text: {(vehicle.texts or ['none'])[-1]}" for vehicle in self.vehicles[:10]
        ]
        return "\n".join(lines)


class Clock:
    """The simulated clock; except on a served fleet, time passes only in these calls."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig

    @property
    def now(self) -> float:
        """The simulated time since the start of the fleet [s]."""
        return self._rig.now

    def run_for(self, seconds: float) -> None:
        """Let time pass [s of simulated time]."""
        __tracebackhide__ = True
        end = self.now + seconds
        while self.now < end - EPSILON_S:
            self._rig.tick()

    def run_until(self, condition: Callable[[], object], timeout: float = 60.0) -> float:
        """Let time pass until the condition holds; return the simulated time taken [s].

        The condition is evaluated before the first tick and after each tick. Raises NotWithinTimeError, an
        AssertionError, after `timeout` [s of simulated time] or a failed action of `vehicle.do`.
        """
        __tracebackhide__ = True
        start = self.now
        while not condition():
            if self.now - start >= timeout - EPSILON_S:
                raise NotWithinTimeError(
                    f"not within {timeout:g} s: {_source_of(condition)}\n{self._rig.state()}"
                )
            self._rig.tick()
        return self.now - start


def _source_of(condition: Callable[[], object]) -> str:
    try:
        return inspect.getsource(condition).strip()
    except (OSError, TypeError):
        return repr(condition)


def scenario_for(
    count: int,
    *,
    seed: int,
    personality: str,
    kind: str,
    faults: Sequence[str],
    params: Mapping[str, float] | None,
    home: tuple[float, float, float],
    wind: Mapping[str, float] | None,
    scenario: Scenario | Path | str | None,
) -> Scenario:
    """Return the scenario of `swarm(...)`; a given scenario replaces count, personality, kind and home.

    Raises ScenarioError for invalid arguments.
    """
    if not (isinstance(count, int) and 1 <= count <= MAX_VEHICLES):
        raise ScenarioError(f"count={count!r}: give a whole number from 1 to {MAX_VEHICLES}")
    _check_choice("personality", personality, [*PERSONALITIES, "mixed"])
    _check_choice("kind", kind, sorted({kind for kinds in PERSONALITIES.values() for kind in kinds}))
    if len(home) != 3 or not (-90 <= home[0] <= 90 and -180 <= home[1] <= 180):
        raise ScenarioError(f"home={home!r}: give latitude, longitude [deg] and altitude [m]")
    if isinstance(faults, str):
        raise ScenarioError(f"faults={faults!r}: give a list, faults=[{faults!r}]")
    if isinstance(scenario, str | Path):
        scenario = load_scenario(Path(scenario))
    if scenario is None:
        scenario = default_scenario(count, home=home, seed=seed, personality=personality, kind=kind)
    data = scenario.model_dump()
    data["seed"] = seed
    data["faults"] = [*data["faults"], *faults]
    data["wind"] = {**data["wind"], **(wind or {})}
    for vehicle in data["vehicles"]:
        vehicle["params"] = {**vehicle["params"], **(params or {})}
    return validated(Scenario, data)


def _check_choice(argument: str, given: str, choices: Sequence[str]) -> None:
    if given not in choices:
        raise ScenarioError(f"{argument}={given!r}: {remedy(given, choices, 'values')}")
