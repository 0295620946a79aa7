"""A small world for tests of the physics: vehicles at the origin of a map, without noise by default."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from sim_vehicle.physics.body import Body
from sim_vehicle.physics.geodesy import LocalFrame
from sim_vehicle.physics.gps import GpsSettings
from sim_vehicle.physics.wind import WindSettings
from sim_vehicle.physics.world import World

STEP_S = 0.05
LAT_DEG, LON_DEG, GROUND_M = 46.05, 14.5, 300.0
PERFECT = GpsSettings(noise_m=0.0, drift_m=0.0)


def world(
    n: int = 1,
    *,
    planes: bool | Sequence[bool] = False,
    wind: WindSettings | None = None,
    gps: GpsSettings = PERFECT,
    seeds: Sequence[int] | None = None,
) -> World:
    seeds = range(n) if seeds is None else seeds
    return World(
        LocalFrame(LAT_DEG, LON_DEG),
        np.full(n, LAT_DEG),
        np.full(n, LON_DEG),
        np.full(n, GROUND_M),
        planes=np.broadcast_to(np.array(planes, dtype=bool), (n,)),
        rngs=[np.random.default_rng(seed) for seed in seeds],
        wind=wind or WindSettings(),
        gps=gps,
    )


def wait(world: World, seconds: float, watch: Callable[[], object] | None = None) -> None:
    for _ in range(round(seconds / STEP_S)):
        world.step(STEP_S)
        if watch is not None:
            watch()


def until(world: World, condition: Callable[[], bool], limit_s: float = 200.0) -> float:
    """Step until `condition`; return the elapsed time [s]."""
    for steps in range(round(limit_s / STEP_S)):
        if condition():
            return steps * STEP_S
        world.step(STEP_S)
    raise AssertionError(f"not within {limit_s} s")


def copter(world: World, index: int = 0, *, height_m: float | None = 50.0) -> Body:
    """Return a copter in the air at a height over the origin, or armed on the ground (None)."""
    body = Body(world, index)
    body.limit(
        speed_m_s=10.0,
        climb_m_s=2.5,
        descent_m_s=1.5,
        acceleration_m_s2=2.5,
        vertical_acceleration_m_s2=1.0,
        acceptance_radius_m=2.0,
    )
    body.arm(True)
    if height_m is not None:
        body.fly_to(0.0, 0.0, GROUND_M + height_m)
        until(world, lambda: body.reached)
        wait(world, 5.0)
    return body


def plane(world: World, index: int = 0, *, height_m: float | None = 50.0) -> Body:
    """Return a plane that circles the origin at a height, or is armed on the ground (None)."""
    body = Body(world, index)
    body.limit(
        speed_m_s=15.0,
        climb_m_s=4.0,
        descent_m_s=4.0,
        acceleration_m_s2=3.0,
        vertical_acceleration_m_s2=3.0,
        acceptance_radius_m=30.0,
        airspeed_min_m_s=10.0,
        airspeed_max_m_s=22.0,
        loiter_radius_m=60.0,
        bank_limit_deg=45.0,
    )
    body.arm(True)
    if height_m is not None:
        body.loiter(0.0, 0.0, GROUND_M + height_m)
        until(world, lambda: body.reached)
        wait(world, 30.0)
    return body


def lone_copter(height_m: float | None = 50.0, **settings: Any) -> tuple[World, Body]:
    made = world(**settings)
    return made, copter(made, height_m=height_m)


def lone_plane(height_m: float | None = 50.0, **settings: Any) -> tuple[World, Body]:
    made = world(planes=True, **settings)
    return made, plane(made, height_m=height_m)
