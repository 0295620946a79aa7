"""The simulator process beside a flight. Both processes share a file, a port, and the simulator's clock.

The ground station steps the simulator's clock (`sim_vehicle --step`). It grants the next step after all
telemetry of the last step has been processed. So a slow ground station slows the simulator down, and never
flies by old telemetry.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from swarmctl.config.autopilots import AUTOPILOTS
from swarmctl.config.scenario import Scenario
from swarmctl.config.specs import Spec, simulated_autopilot
from swarmctl.links.url import Endpoint
from swarmctl.preflight.declared import simulated_parameters

STOP_DEADLINE_S = 5.0
STEP_S = 0.1
"""longest step of the simulator's clock [s]"""
STEP_WALL_S = 0.05
"""longest step, in real time [s]: a shorter step at a low speed-up lets the vehicles answer sooner"""
CATCH_UP_S = 0.2
"""longest delay that faster steps make up, in real time [s]; a longer delay slows the flight down"""
ANSWER = b"at "
"""beginning of the simulator's answer to a step"""
CHECK_S = 0.001
"""time between two checks whether the ground station has processed all telemetry [s]"""


class SimulatorFailed(Exception):
    """An early end of the simulator; after an error the text has the last lines of `simulator.log`."""


def scenario_json(scenario: Scenario) -> dict[str, Any]:
    """Return the simulator's scenario: this process's simulated vehicles, the area and the true threats."""
    simulate = scenario.config.simulate
    assert simulate is not None
    grid, strength = scenario.grid, scenario.strength
    # `swarm` has all vehicles as configured; `specs` has the vehicles of this process, with the chosen port.
    simulated = {spec.sysid for spec in scenario.specs if spec.simulated}
    return {
        "seed": scenario.config.seed,
        "vehicles": [
            {
                "sysid": spec.sysid,
                "lat_deg": spec.start[0],
                "lon_deg": spec.start[1],
                "alt_amsl_m": simulate.home_alt_amsl_m,
                **_autopilot(scenario, index),
            }
            for index, spec in enumerate(scenario.swarm)
            if spec.sysid in simulated
        ],
        "area": {
            "origin_lat_deg": grid.origin_lat_deg,
            "origin_lon_deg": grid.origin_lon_deg,
            "rows": grid.rows,
            "cols": grid.cols,
            "cell_size_m": grid.cell_size_m,
        },
        "firing_strength": [strength.direct, strength.first_neighbour, strength.second_neighbour],
        "hostiles": [list(cell) for cell in sorted(scenario.hostiles)],
    }


def _autopilot(scenario: Scenario, index: int) -> dict[str, Any]:
    """Return airframe, autopilot and parameters of the vehicle `index` of the swarm."""
    spec = scenario.swarm[index]
    autopilot = AUTOPILOTS[simulated_autopilot(scenario.config, index)]
    body: dict[str, Any] = {"personality": autopilot.personality}
    if autopilot.airframe == "plane":
        # The plane points along its first leg, because it takes off straight ahead.
        body |= {"type": "plane", "heading_deg": _heading_deg(scenario, spec)}
    params = autopilot.params(spec.speed_m_s, math.floor(scenario.config.wings.min_speed_m_s))
    # On a real vehicle, the owner or `preflight.set_parameters` sets these parameters.
    params |= simulated_parameters(scenario, spec, autopilot.firmware)
    return {**body, "params": params}


def _heading_deg(scenario: Scenario, spec: Spec) -> float:
    (e0, n0), (e1, n1) = scenario.grid.frame.to_local(*spec.start), scenario.grid.centre_m(spec.entry)
    return math.degrees(math.atan2(e1 - e0, n1 - n0)) % 360.0


async def run_simulator(
    scenario: Scenario, listening: Endpoint, folder: Path, has_unprocessed: Callable[[], bool]
) -> None:
    """Run the simulator process until cancelled. Raises SimulatorFailed when the process ends.

    listening: the ground station's endpoint, to which the simulator connects
    has_unprocessed: function that returns whether received telemetry still waits; the simulator waits then.
    """
    simulate = scenario.config.simulate
    assert simulate is not None
    url = f"{'udpout' if listening.kind == 'udpin' else 'tcpout'}://{_connect_address(listening)}"
    file, log = folder / "scenario.json", folder / "simulator.log"
    file.write_text(json.dumps(scenario_json(scenario), indent=1) + "\n", encoding="utf-8")
    command = [
        sys.executable, "-m", "sim_vehicle",
        "--scenario", str(file), "--url", url, "--step",
        "--ready-s", str(simulate.ready_s), "--parent-pid", str(os.getpid()),
    ]  # fmt: skip
    with log.open("wb", buffering=0) as output:
        # In a new session Ctrl-C does not end the simulator, whose vehicles the shutdown still needs.
        pipe = asyncio.subprocess.PIPE
        process = await asyncio.create_subprocess_exec(
            *command, stdin=pipe, stdout=pipe, stderr=output, start_new_session=True
        )
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            await step_clock(process.stdin, process.stdout, output.write, simulate.speedup, has_unprocessed)
            raise _failure(await process.wait(), log)
        finally:
            await _stop(process)
            rest = (await process.stdout.read()).splitlines(keepends=True)
            output.writelines(line for line in rest if not line.startswith(ANSWER))


def _connect_address(endpoint: Endpoint) -> str:
    host = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(endpoint.host, endpoint.host)
    return f"[{host}]:{endpoint.port}" if ":" in host else f"{host}:{endpoint.port}"


async def step_clock(
    requests: asyncio.StreamWriter,
    answers: asyncio.StreamReader,
    log: Callable[[bytes], object],
    speedup: float,
    has_unprocessed: Callable[[], bool],
) -> None:
    """Step the simulator's clock until the end of `answers`, at most `speedup` times as fast as real time."""
    loop = asyncio.get_running_loop()
    step_s = min(STEP_S, STEP_WALL_S * speedup)
    due_s = loop.time()
    with contextlib.suppress(ConnectionError):
        while True:
            requests.write(f"step {step_s:g}\n".encode())
            await requests.drain()
            while not (line := await answers.readline()).startswith(ANSWER):
                if not line:
                    return
                log(line)
            # Polled: the end of the processing raises no event.
            while has_unprocessed():  # noqa: ASYNC110
                await asyncio.sleep(CHECK_S)
            due_s = max(due_s + step_s / speedup, loop.time() - CATCH_UP_S)
            await asyncio.sleep(due_s - loop.time())


def _failure(code: int, log: Path) -> SimulatorFailed:
    how = f"was killed by signal {-code}" if code < 0 else f"ended with code {code}"
    lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
    last = f"; its last lines: {' / '.join(lines[-3:])}" if code > 0 and lines else ""
    return SimulatorFailed(f"the simulator {how}{last} [simulator-ended]")


async def _stop(process: asyncio.subprocess.Process) -> None:
    if process.returncode is not None:
        return
    process.terminate()
    try:
        async with asyncio.timeout(STOP_DEADLINE_S):
            await process.wait()
    except TimeoutError:
        process.kill()
        await process.wait()
