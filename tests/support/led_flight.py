"""A vehicle in flight that follows a moving place by set-points."""

from __future__ import annotations

from collections.abc import Callable

from flying_bench import FlyingBench

from swarmctl.core.geo import LocalFrame, distance_m
from swarmctl.core.setpoint import SetPoint
from swarmctl.mavlink.procedures import basic
from swarmctl.mavlink.session import SessionStep

Velocity = tuple[float, float, float]


class Leader:
    """A place that begins at the vehicle and moves at a constant velocity (east, north, up) [m/s]."""

    def __init__(self, bench: FlyingBench, velocity_m_s: Velocity) -> None:
        lat_deg, lon_deg = bench.vehicle.body.place_deg(*bench.vehicle.body.position_m[:2])
        self._frame = LocalFrame(lat_deg, lon_deg)
        self._alt_m, self._since_s, self._velocity_m_s = (
            bench.vehicle.body.position_m[2],
            bench.now,
            velocity_m_s,
        )

    def at(self, now: float) -> SetPoint:
        east_m, north_m, up_m = (v * (now - self._since_s) for v in self._velocity_m_s)
        place = self._frame.to_geodetic(east_m, north_m)
        return SetPoint(self._velocity_m_s, place, self._alt_m + up_m)


def lead(
    bench: FlyingBench,
    setpoint: Callable[[float], SetPoint],
    seconds: float,
    *,
    hz: float = 10.0,
    until: Callable[[], bool] = lambda: False,
) -> bool:
    """Send set-points for some time; return True as soon as `until()` holds."""
    for _ in range(round(seconds * hz)):
        message = bench.session.setpoint_message(setpoint(bench.now), bench.now)
        bench.take(SessionStep([message], []))
        if bench.run(1.0 / hz, until):
            return True
    return False


def follow(bench: FlyingBench, setpoint: Callable[[float], SetPoint]) -> basic.Done:
    """Enter the set-point mode while set-points stream; return the outcome."""
    lead(bench, setpoint, 0.5)
    bench.begin("follow", basic.follow_setpoints)
    assert lead(bench, setpoint, 60.0, until=lambda: bench.session.busy_with is None)
    return bench.result


def errors_m(bench: FlyingBench, setpoint: SetPoint) -> tuple[float, float]:
    """Return the true distance over ground, and the difference in height, from the place of a set-point."""
    body = bench.vehicle.body
    place = body.place_deg(*body.position_m[:2])
    return distance_m(place, setpoint.at), abs(body.position_m[2] - setpoint.alt_amsl_m)


def speed_m_s(bench: FlyingBench) -> float:
    east, north, _ = bench.vehicle.body.velocity_m_s
    return (east**2 + north**2) ** 0.5
