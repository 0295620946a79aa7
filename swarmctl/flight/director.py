"""The course of a flight: all vehicles answer, become ready, receive a verified mission, then launch.

Before the launch all vehicles are on the ground, and one failed vehicle stops the whole flight. After the
launch a failed vehicle is reported, and the other vehicles fly on.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Coroutine, Sequence
from functools import partial
from typing import Any, Literal, Protocol

from swarmctl.agent.phases import IN_FLIGHT, ON_GROUND, Phase
from swarmctl.config.flight import FlightSection
from swarmctl.core import events as ev
from swarmctl.core.geo import distance_m
from swarmctl.core.operator_text import extended
from swarmctl.flight.flight_end import FlightEnd
from swarmctl.flight.own_vehicle import POLL_S, OwnVehicle, names, until
from swarmctl.flight.permission import Permission, PreflightFailed, vehicles_to_permit
from swarmctl.flight.shutdown import Shutdown
from swarmctl.flight.takeover import Takeover
from swarmctl.links.base import LinkError
from swarmctl.report.final_state import is_released_in_air

START_TOLERANCE_M = 100.0
"""greatest distance between a vehicle and its configured start [m]"""
NOT_READY_S = 20.0
"""time between two messages about a vehicle that is not ready [s]; a shorter wait gives no message"""
PARTIAL_CHECKS_S = 10.0
"""time limit for the checks of the vehicles that have answered, when preflight is stopped [s]"""
EARLY_CHECKS_S = 3.0
"""time between two searches for vehicles that have become ready, for early checks [s]"""
RETRY_S = 5.0
"""time between a failed preparation of a waiting vehicle and the next attempt [s]"""

LaunchMode = Literal["when-ready", "ordered", "never"]
"""when-ready: the director launches the vehicles.
ordered: the director keeps the vehicles ready until an operator orders the launch.
never: preflight checks only; no vehicle gets the permission to arm."""


Step = Callable[[OwnVehicle], Coroutine[Any, Any, None]]
"""a step of the preparation of one vehicle"""


class Clearance(Protocol):
    """The preflight checks, which never arm a vehicle."""

    async def set_up(self, subject: OwnVehicle) -> None:
        """Prepare a vehicle's parameters before it becomes ready. Raises LinkError."""

    async def failures(self, subjects: Sequence[OwnVehicle], everyone: Sequence[OwnVehicle]) -> list[str]:
        """Return a line for each failed check of vehicles that have answered."""

    async def early_failures(self, subject: OwnVehicle, everyone: Sequence[OwnVehicle]) -> list[str]:
        """Return the failed checks of a vehicle that is ready before other vehicles, for an early report."""


class Director:
    """The course of one flight: `fly` until its end, or `shut_down` after `fly` was cancelled."""

    def __init__(
        self,
        vehicles: Sequence[OwnVehicle],
        flight: FlightSection,
        *,
        seconds_per_delay: float,
        say: Callable[[str], None],
        permission: Permission,
        clearance: Clearance,
        launch: LaunchMode = "when-ready",
        flies_all: bool = True,
        takeover: Takeover | None = None,
    ) -> None:
        """Direct a new flight, or one that another program began.

        flies_all: False for a process that flies one vehicle of a swarm
        takeover: for a flight that another program began; None: a new flight
        """
        self._vehicles = vehicles
        self._section = flight
        self._seconds_per_delay = seconds_per_delay
        self._say = say
        self._permission = permission
        self._clearance = clearance
        self._when_ready = launch == "when-ready"
        self._checks_only = launch == "never"
        self._flies_all = flies_all
        self._takeover = takeover
        self._is_stopping = False

    @property
    def on_ctrl_c(self) -> str:
        """The effect of Ctrl-C now, as text."""
        if self._is_stopping:
            return "end the program at once"
        if any(m.state.phase in IN_FLIGHT or m.state.phase is Phase.LAUNCHING for m in self._vehicles):
            order = self._section.on_exit
            return "hold, and end with vehicles in the air" if order == "hold" else f"hold, then {order}"
        released = any(is_released_in_air(m.state) for m in self._vehicles)
        return "end, with released vehicles in the air" if released else "end"

    async def shut_down(self) -> None:
        """End the flight early and orderly."""
        self._is_stopping = True
        if self._checks_only:
            await self._check_answered()
        else:
            await Shutdown(self._vehicles, self._section, self._say, flies_all=self._flies_all).run()

    async def _check_answered(self) -> None:
        """Check the vehicles that have answered, ready or not."""
        answered = [m for m in self._vehicles if m.identity is not None]
        self._say(f"the preflight stops; checking the data received from {names(answered) or 'no vehicle'}")
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(PARTIAL_CHECKS_S):
                await self._clearance.failures(answered, answered)

    async def fly(self) -> None:
        """Run the flight to its end. Raises PreflightFailed before arming."""
        if self._takeover is None:
            await self._prepare_flight()
        if self._checks_only:
            return
        async with asyncio.TaskGroup() as flights:
            for vehicle in self._vehicles:
                flights.create_task(self._begin_flight(vehicle))
        end = FlightEnd(self._vehicles, self._section.lost_timeout_s, self._say)
        while not end.reached():  # noqa: ASYNC110 - silence raises no event
            await asyncio.sleep(POLL_S)

    async def _begin_flight(self, vehicle: OwnVehicle) -> None:
        """Take the vehicle over if another program began the flight, and launch it from the ground."""
        if self._takeover is not None:
            await self._takeover.run(vehicle, lambda m: self._permit([m]))
            await until(lambda m: not m.runner.is_untaken, [vehicle])
            if vehicle.state.ended or vehicle.state.phase not in ON_GROUND:
                return
            await self._prepare_with_others(vehicle)
        await self._launch(vehicle)

    async def _prepare_with_others(self, vehicle: OwnVehicle) -> None:
        """Wait until all vehicles on the ground have their first routes, because the checks compare them."""

        def has_route(m: OwnVehicle) -> bool:
            return not (m.runner.is_untaken or m.state.phase in (Phase.WAITING, Phase.UPLOADING))

        # `_launch` tries again what fails here.
        with contextlib.suppress(LinkError, PreflightFailed, TimeoutError):
            await self._clearance.set_up(vehicle)
            await self._make_ready(vehicle)
            async with asyncio.timeout(self._section.ready_timeout_s):
                await until(has_route, self._vehicles)

    async def _prepare_flight(self) -> None:
        if failures := await self._run_for_all(self._connect):
            raise PreflightFailed(failures)
        if self._checks_only:
            vehicles_to_permit(self._vehicles)
            await self._prepare_all()
            return
        self._permit(self._vehicles)
        await self._prepare_all()
        next_step = "launching" if self._when_ready else "waiting for the order to launch"
        self._say(f"{self._readiness()}; {next_step} [ready]")

    def _readiness(self) -> str:
        released = [m for m in self._vehicles if self._is_released(m)]
        if len(released) == len(self._vehicles):
            return f"another station or a pilot has armed {names(released)}"
        ready = "every vehicle" if len(self._vehicles) > 1 else names(self._vehicles)
        text = f"{ready} has its mission, verified by a download"
        if released:
            text = f"{text}, except {names(released)}, armed by another station or a pilot"
        return text

    async def _prepare_all(self) -> None:
        """Set up, make ready and check all vehicles. Raises PreflightFailed with every failure."""
        failures: list[str] = []
        for step in (self._clearance.set_up, self._make_ready):
            failures += await self._run_for_all_reported(step)
        unreleased = [m for m in self._vehicles if not self._is_released(m)]
        try:
            await self._clear(unreleased)
        except PreflightFailed as failed:
            failures += failed.lines
        # A pilot or another station may have taken over a vehicle that was ready.
        failures += [f"{m.name}: {m.state.outcome}" for m in unreleased if m.state.ended]
        failures += [m.final_state() for m in unreleased if m.state.lost]
        if failures:
            raise PreflightFailed(list(dict.fromkeys(failures)))

    def _is_released(self, vehicle: OwnVehicle) -> bool:
        """Return whether the flight continues without this vehicle, because the vehicle is released.

        The link and the heartbeats to the vehicle continue. In a run of checks only, a released vehicle
        counts as failed.
        """
        return not self._checks_only and vehicle.state.phase is Phase.RELEASED

    async def _clear(self, vehicles: Sequence[OwnVehicle]) -> None:
        """Check vehicles and clear them for launch. Raises PreflightFailed with all failures."""
        failures = await self._clearance.failures(vehicles, self._vehicles)
        if failures:
            raise PreflightFailed(failures)
        for vehicle in vehicles:
            vehicle.runner.clearance.give()

    async def _prepare_again(self, vehicle: OwnVehicle) -> None:
        """Repeat the whole preparation after a reboot; otherwise repeat only checks that are too old."""
        if not vehicle.runner.clearance.is_given:
            await self._clearance.set_up(vehicle)
        await self._make_ready(vehicle)
        if not vehicle.runner.clearance.is_fresh and not vehicle.state.ended:
            await self._clear([vehicle])

    def _permit(self, vehicles: Sequence[OwnVehicle]) -> None:
        """Make vehicles armable, after permission for those not simulated. Raises PreflightFailed."""
        external = vehicles_to_permit(vehicles)
        if external:
            self._permission(external)
        for vehicle in vehicles:
            vehicle.permit(partial(self._clearance.failures, [vehicle], self._vehicles))

    async def _run_for_all_reported(self, step: Step) -> list[str]:
        """Run a preflight step as `_run_for_all` does; report failures at once if other vehicles are busy."""
        under_way = {m.name for m in self._vehicles if not self._is_released(m)}

        async def reported(vehicle: OwnVehicle) -> None:
            try:
                await step(vehicle)
            except (LinkError, PreflightFailed) as error:
                if under_way - {vehicle.name} and not self._is_released(vehicle):
                    self._say(extended(str(error), "; waiting for the other vehicles"))
                raise
            finally:
                under_way.discard(vehicle.name)

        async with asyncio.TaskGroup() as tasks:
            early = tasks.create_task(self._report_early())
            failures = await self._run_for_all(reported)
            early.cancel()
        return failures

    async def _report_early(self) -> None:
        """Check each vehicle once, as soon as it is ready. `_prepare_all` checks all vehicles again."""
        unchecked = {m.name: m for m in self._vehicles}
        while unchecked:
            await asyncio.sleep(EARLY_CHECKS_S)
            for vehicle in [m for m in unchecked.values() if m.state.phase is Phase.STANDBY]:
                del unchecked[vehicle.name]
                for text in await self._clearance.early_failures(vehicle, self._vehicles):
                    self._say(extended(text, "; waiting for the other vehicles"))

    async def _run_for_all(self, step: Step) -> list[str]:
        """Run one preflight step on all vehicles at once, and return the failures.

        Failures of released vehicles are left out (see `_is_released`).
        """
        vehicles = [m for m in self._vehicles if not self._is_released(m)]
        async with asyncio.TaskGroup() as tasks:
            results = [tasks.create_task(_failure(step(vehicle))) for vehicle in vehicles]
        failures = {m: task.result() for m, task in zip(vehicles, results, strict=True)}
        failed = [m for m in vehicles if failures[m] and not self._is_released(m)]
        for vehicle in failed:
            vehicle.fail(failures[vehicle])
        return [failures[vehicle] for vehicle in failed]

    async def _connect(self, vehicle: OwnVehicle) -> None:
        identity = await vehicle.connect(self._section.connect_timeout_s)
        self._say(f"{vehicle.name}: connected to {identity.firmware}, system id {identity.sysid}")
        found = vehicle.runner.link.state()
        if found.armed:
            advice = "disarm the vehicle, or remove it from the configuration [already-armed]"
            raise PreflightFailed([f"{vehicle.name}: already armed, in mode {found.mode or '?'}; {advice}"])

    async def _make_ready(self, vehicle: OwnVehicle) -> None:
        """Wait until the vehicle has a verified mission; begin again after each reboot."""
        while not (vehicle.state.phase is Phase.STANDBY or vehicle.state.ended):
            await self._prepare(vehicle)
            vehicle.runner.post(_ready(vehicle))
            await until(lambda m: m.state.phase is not Phase.WAITING or m.state.lost, [vehicle])
            await until(lambda m: m.state.phase is not Phase.UPLOADING or m.state.lost, [vehicle])
            if vehicle.state.lost:
                break
        if vehicle.state.ended:
            raise PreflightFailed([f"{vehicle.name}: {vehicle.state.outcome}"])
        if vehicle.state.lost:
            raise PreflightFailed([vehicle.final_state()])

    async def _prepare(self, vehicle: OwnVehicle) -> None:
        timeout_s = self._section.ready_timeout_s
        most = f"waiting {timeout_s:g} s at most [not-ready]"
        await vehicle.prepare(
            timeout_s,
            report_every_s=NOT_READY_S * self._seconds_per_delay,
            on_overdue=lambda reasons: self._say(f"{vehicle.name}: not ready yet: {reasons}; {most}"),
        )
        where = vehicle.runner.link.state()
        if where.lat_deg is None or where.lon_deg is None:
            raise PreflightFailed(
                [f"{vehicle.name}: ready, but its telemetry has no position; check its GPS"]
            )
        away_m = distance_m((where.lat_deg, where.lon_deg), vehicle.spec.start)
        if away_m > START_TOLERANCE_M:
            raise PreflightFailed([_misplaced(vehicle, away_m)])

    async def _launch(self, vehicle: OwnVehicle) -> None:
        if self._is_released(vehicle):
            return
        if self._when_ready:
            await self._launch_when_ready(vehicle)
        await self._stand_by(vehicle)

    async def _launch_when_ready(self, vehicle: OwnVehicle) -> None:
        """Launch after the configured delay. A vehicle that is no longer ready is made ready first.

        If the preparation fails, the vehicle stays on the ground.
        """
        await asyncio.sleep(vehicle.spec.delay_s * self._seconds_per_delay)
        try:
            await self._prepare_again(vehicle)
        except (LinkError, PreflightFailed) as error:
            self._say(extended(str(error), "; the vehicle stays on the ground"))
            vehicle.runner.post(ev.OperatorCommand(ev.FlightOrder.HOLD))
            return
        vehicle.runner.post(ev.OperatorCommand(ev.FlightOrder.LAUNCH))

    async def _stand_by(self, vehicle: OwnVehicle) -> None:
        """Keep the vehicle ready for the order to launch, while it is on the ground."""
        # A vehicle whose launch is refused stands by again.
        before_flight = ON_GROUND | {Phase.LAUNCHING}
        while vehicle.state.phase in before_flight and not (self._when_ready and self._is_over(vehicle)):
            if vehicle.state.lost or not _needs_preparation(vehicle):
                await asyncio.sleep(POLL_S)
                continue
            try:
                await self._prepare_again(vehicle)
            except (LinkError, PreflightFailed) as error:
                if not vehicle.state.ended:
                    self._say(extended(str(error), f"; next attempt in {RETRY_S:g} s"))
                    await asyncio.sleep(RETRY_S)

    def _is_over(self, vehicle: OwnVehicle) -> bool:
        return vehicle.state.ended or vehicle.silent_for(self._section.lost_timeout_s)


async def _failure(step: Coroutine[Any, Any, None]) -> str:
    """Carry out a step, and return its failure as text; empty if there is none."""
    try:
        await step
    except (LinkError, PreflightFailed) as error:
        return str(error)
    return ""


def _ready(vehicle: OwnVehicle) -> ev.Ready:
    found = vehicle.identity
    return ev.Ready() if found is None else ev.Ready(found.firmware, found.uid2.hex())


def _needs_preparation(vehicle: OwnVehicle) -> bool:
    phase = vehicle.state.phase
    return phase is Phase.WAITING or (phase is Phase.STANDBY and not vehicle.runner.clearance.is_given)


def _misplaced(vehicle: OwnVehicle, away_m: float) -> str:
    lat_deg, lon_deg = vehicle.spec.start
    return (
        f"{vehicle.name}: {away_m:.0f} m from its configured start ({lat_deg:.6f}, {lon_deg:.6f}), expected "
        f"at most {START_TOLERANCE_M:g} m; correct `start`, or carry the vehicle there [start-distance]"
    )
