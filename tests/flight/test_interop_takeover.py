"""SIGKILL of `swarmctl fly` in flight; its vehicles are those of another process, so they fly on."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from simulator_process import free_udp_port, simulator
from swarmctl_process import read_until, run, started, swarmctl

from swarmctl.report.unfinished_run import CONTINUED

pytestmark = pytest.mark.interop

NAMES = ("alpha", "beta")


def configuration(port: int) -> str:
    vehicles = "".join(
        f'  - {{name: {name}, url: "udpin://127.0.0.1:{port}", sysid: {7 + i}, '
        f"start: {{lat_deg: {46.0 + 0.0009 * i}, lon_deg: 14.399}}, goal: [{1 + 4 * i}, 7]}}\n"
        for i, name in enumerate(NAMES)
    )
    return (
        "name: killed\n"
        "area: {origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 8, cols: 8, cell_size_m: 50}\n"
        "threats: {count: 5}\n"
        "preflight: {set_parameters: true}\n"
        f"communication: {{listen: none}}\nvehicles:\n{vehicles}"
    )


@pytest.mark.full
def test_a_killed_station_is_continued(tmp_path: Path) -> None:
    port = free_udp_port()
    config = tmp_path / "killed.yaml"
    config.write_text(configuration(port))
    vehicles = tmp_path / "vehicles.json"
    start = {"alt_amsl_m": 300.0, "personality": "ardupilot"}
    vehicles.write_text(
        json.dumps(
            {
                "vehicles": [
                    {"sysid": 7 + i, "lat_deg": 46.0 + 0.0009 * i, "lon_deg": 14.399, **start}
                    for i in range(len(NAMES))
                ]
            }
        )
    )
    url = f"udpout://127.0.0.1:{port}"
    with simulator("--scenario", str(vehicles), "--url", url, "--speedup", "5", errors=lambda _: True):
        with started("fly", "--config", config, cwd=tmp_path) as station:
            read_until(station, "beta: flying")
            (folder,) = (tmp_path / "runs").iterdir()
            again = swarmctl("fly", "--resume", folder)
            assert (again.exit_code, "[still-running]" in again.output) == (1, True)
        done = run("fly", "--resume", "last", cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    # On a busy machine a vehicle may have landed before.
    assert "[taken-up]" in done.stdout
    assert "[not-taken-over]" not in done.stdout
    (new,) = set((tmp_path / "runs").iterdir()) - {folder}
    summary = json.loads((new / "summary.json").read_text())
    assert (summary["arrived"], summary["continues"]) == (len(NAMES), folder.name)
    assert run("replay", new, cwd=tmp_path).returncode == 0
    assert run("audit", new, cwd=tmp_path).returncode == 0
    ended = run("fly", "--resume", new, cwd=tmp_path)
    assert (ended.returncode, "[run-ended]" in ended.stderr) == (1, True)
    twice = run("fly", "--resume", folder, cwd=tmp_path)
    assert (twice.returncode, "[run-continued]" in twice.stderr) == (1, True)
    (folder / CONTINUED).unlink()
    config.write_text(config.read_text().replace("count: 5", "count: 6"))
    other = run("fly", "--config", config, "--resume", folder, cwd=tmp_path)
    assert (other.returncode, "[other-configuration]" in other.stderr) == (1, True)
