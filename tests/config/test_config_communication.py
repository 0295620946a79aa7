"""What is wrong with the section `communication`, said with file, line and cure before anything starts."""

from __future__ import annotations

from pathlib import Path

import pytest

from swarmctl.config.checks import check_config
from swarmctl.config.model import ConfigError, load

REST = """\
area: {origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 8, cols: 8, cell_size_m: 50}
threats: {count: 5}
"""
SIMULATED = "simulate: {count: 3}\n"
ALPHA = (
    'vehicles: [{name: alpha, url: "udpin://:14999", sysid: 2, goal: [3, 7], '
    "start: {lat_deg: 46.00157, lon_deg: 14.3994}}]\n"
)
MESH = "mesh: {uav1: tcp/10.0.0.1:7447, uav2: tcp/10.0.0.2:7447, uav3: tcp/10.0.0.3:7447}"


def troubles(tmp_path: Path, communication: str, vehicles: str = SIMULATED) -> list[str]:
    """What is said about this section on line 4, without the file's name and the section's."""
    file = tmp_path / "swarm.yaml"
    file.write_text(f"{REST}{vehicles}communication: {{{communication}}}\n")
    try:
        load(file, check_config)
    except ConfigError as error:
        return [line.removeprefix(f"{file}:4: communication").removeprefix(".") for line in error.lines]
    return []


RIGHT = [
    "",
    "range: 200",
    "loss: 0.9, loss_burst: 9",
    "loss: 0.25, loss_burst: 1",
    "max_distance_m: 500, min_distance_m: 100, relay: true",
    "bandwidth_bytes_s: 2000, jitter_s: 5, delay_s: 3",
    "delay_s: 10, sync_every_s: 0",
    "partitions: [{from_s: 0, groups: [[uav1, 2]]}, {from_s: 5, until_s: 9, groups: [[1], [uav2, '3']]}]",
    "quiet: [{uavs: [uav1, 3], from_s: 5, until_s: 9}, {uavs: [1]}]",
    "router: tcp/192.168.1.10:7447",
    MESH,
    "mesh: {1: tcp/10.0.0.1:7447, uav2: tcp/10.0.0.2:7447, '3': tcp/10.0.0.3:7447}",
    "listen: none",
]


@pytest.mark.parametrize("communication", RIGHT)
def test_nothing_is_said_where_nothing_is_wrong(communication: str, tmp_path: Path) -> None:
    assert troubles(tmp_path, communication) == []


THERE = "there is 1 (uav1), 2 (uav2), 3 (uav3)"
ROWS = [
    (
        "bursts too short for the share",
        "loss: 0.9, loss_burst: 1",
        ["loss_burst: 1 in a row cannot make up 0.9 of all: between two bursts one comes through; give at "
         "least 9, or less loss"],
    ),
    (
        "the same, rounded so that what is read can be given",
        "loss: 0.6, loss_burst: 1.3",
        ["loss_burst: 1.3 in a row cannot make up 0.6 of all: between two bursts one comes through; give at "
         "least 1.5, or less loss"],
    ),
    ("bursts of nothing", "loss_burst: 3", [": loss_burst says how losses cluster; give loss too"]),
    (
        "the same question before the last is heard",
        "delay_s: 5",
        ["sync_every_s: 3 is shorter than delay_s = 5: a UAV would ask again before its question is heard; "
         "give at least 5, or 0 to ask for nothing"],
    ),
    (
        "nowhere to hear each other",
        "min_distance_m: 500, max_distance_m: 400",
        [": min_distance_m 500 leaves nothing below max_distance_m 400"],
    ),
    (
        "groups of nobody",
        "partitions: [{from_s: 0, groups: [[uav1], [uav4, 9]]}]",
        [f"partitions[0].groups[1][0]: no vehicle has the system id or name uav4; {THERE}",
         f"partitions[0].groups[1][1]: no vehicle has the system id or name 9; {THERE}"],
    ),
    (
        "in two groups at once, by name and by system id",
        "partitions: [{from_s: 0, groups: [[uav1, uav2], [2, uav3]]}]",
        ["partitions[0].groups[1][0]: uav2 is given twice; a UAV is in one group of a partition, once"],
    ),
    (
        "an empty group",
        "partitions: [{from_s: 0, groups: [[1], []]}]",
        ["partitions[0]: a group is empty; leave it away, or say who is in it"],
    ),
    (
        "a partition that ends before it begins",
        "partitions: [{from_s: 9, until_s: 5, groups: [[uav1]]}]",
        ["partitions[0]: until_s 5 is not after from_s 9; a time ends after it begins"],
    ),
    (
        "a quiet time that ends as it begins",
        "quiet: [{uavs: [1], from_s: 9, until_s: 9}]",
        ["quiet[0]: until_s 9 is not after from_s 9; a time ends after it begins"],
    ),
    (
        "nobody who is quiet, and one twice",
        "quiet: [{uavs: [alpha, uav1, 1]}]",
        [f"quiet[0].uavs[0]: no vehicle has the system id or name alpha; {THERE}",
         "quiet[0].uavs[2]: uav1 is given twice; once is enough"],
    ),
    (
        "a mesh without some",
        "mesh: {uav2: tcp/10.0.0.2:7447}",
        ["mesh: uav1, uav3 cannot be found by the others; give each vehicle an endpoint"],
    ),
    (
        "a mesh with one too many",
        f"{MESH[:-1]}, uav4: tcp/10.0.0.4:7447}}",
        [f"mesh.uav4: no vehicle has the system id or name uav4; {THERE}"],
    ),
    (
        "a mesh with one twice",
        f"{MESH[:-1]}, 3: tcp/10.0.0.4:7447}}",
        ["mesh.3: uav3 is given twice; a vehicle listens at one endpoint"],
    ),
    (
        "two at one endpoint",
        "mesh: {uav1: tcp/10.0.0.1:7447, uav2: tcp/10.0.0.2:7447, uav3: tcp/10.0.0.1:7447}",
        ["mesh.uav3: tcp/10.0.0.1:7447 is uav1's; give each vehicle its own"],
    ),
    (
        "where nobody can connect to",
        "router: tcp/0.0.0.0:7447",
        ["router: 'tcp/0.0.0.0:7447': others have to find it; give the address or name of the machine"],
    ),
    (
        "a port that nobody can know",
        "mesh: {uav1: tcp/10.0.0.1:0, uav2: tcp/10.0.0.2:7447, uav3: tcp/10.0.0.3:7447}",
        ["mesh.uav1: 'tcp/10.0.0.1:0': others have to find it; give it a port"],
    ),
    (
        "a star and a mesh",
        f"router: tcp/10.0.0.9:7447, {MESH}",
        [": router makes a star and mesh does without; give one of them"],
    ),
    (
        "a star within one process",
        "bus: memory, router: tcp/10.0.0.9:7447",
        ["router: bus: memory stays within one process; give bus: zenoh, or leave this away"],
    ),
    ("keys that sign the evidence alone", "keys: keys", []),
    ("and on one machine", "keys: keys, bus: memory, listen: tcp/localhost:0", []),
    (
        "keys that do not keep others away",
        "keys: keys, listen: tcp/0.0.0.0:7447",
        ["listen: others than this machine reach tcp/0.0.0.0:7447, and communication.keys does not keep them "
         "away: without router or mesh it signs the evidence alone; give tcp/127.0.0.1:0, or "
         "leave keys away"],
    ),
    (
        "keys that the router does not use",
        "keys: keys, router: tcp/10.0.0.9:7447",
        ["router: tcp/10.0.0.9:7447 would not use communication.keys; write tls/ or quic/ instead of tcp/, "
         "or leave keys away"],
    ),
]  # fmt: skip


@pytest.mark.parametrize(
    ("communication", "expected"), [row[1:] for row in ROWS], ids=[row[0] for row in ROWS]
)
def test_what_is_wrong_is_said_with_a_cure(communication: str, expected: list[str], tmp_path: Path) -> None:
    assert troubles(tmp_path, communication) == expected


SECURE = [
    ("a router with keys", "keys: keys, router: tls/10.0.0.9:7447", []),
    (
        "a mesh with keys",
        "keys: k, mesh: {1: quic/10.0.0.1:7447, 2: tls/10.0.0.2:7447, 3: tls/10.0.0.3:7447}",
        [],
    ),
    (
        "no keys",
        "router: tls/10.0.0.9:7447",
        ["router: tls/10.0.0.9:7447 needs certificates; give communication.keys the folder that "
         "`swarmctl keys` made, or write tcp/"],
    ),
    (
        "a flight that listens with certificates",
        "listen: tls/10.0.0.9:7447",
        ["listen: tls/10.0.0.9:7447: a flight in one process is reached over tcp/ alone; give tcp/HOST:PORT, "
         "or none"],
    ),
    (
        "keys and nobody who listens",
        "keys: keys, listen: none",
        [],
    ),
    (
        "one of the mesh without",
        "keys: k, mesh: {1: quic/10.0.0.1:7447, 2: tcp/10.0.0.2:7447, 3: tls/10.0.0.3:7447}",
        ["mesh.2: tcp/10.0.0.2:7447 would not use communication.keys; write tls/ or quic/ instead of tcp/, "
         "or leave keys away"],
    ),
]  # fmt: skip


@pytest.mark.parametrize(
    ("communication", "expected"), [row[1:] for row in SECURE], ids=[r[0] for r in SECURE]
)
def test_endpoints_with_certificates_and_keys_go_together(
    communication: str, expected: list[str], tmp_path: Path
) -> None:
    assert troubles(tmp_path, communication) == expected


def test_vehicles_with_a_url_are_meant_by_their_names_and_system_ids(tmp_path: Path) -> None:
    assert (
        troubles(tmp_path, "quiet: [{uavs: [alpha]}], partitions: [{from_s: 0, groups: [[2]]}]", ALPHA) == []
    )
    said = troubles(tmp_path, "quiet: [{uavs: [uav2]}]", ALPHA)
    assert said == ["quiet[0].uavs[0]: no vehicle has the system id or name uav2; there is 2 (alpha)"]


def test_a_word_that_means_two_vehicles_says_so(tmp_path: Path) -> None:
    vehicles = ALPHA.replace("alpha", '"1"') + "simulate: {count: 1}\n"
    file = tmp_path / "swarm.yaml"
    file.write_text(f"{REST}{vehicles}communication: {{quiet: [{{uavs: [1]}}]}}\n")
    with pytest.raises(ConfigError, match=r":5: communication\.quiet\[0\]\.uavs\[0\]: 1 means two vehicles"):
        load(file, check_config)


def test_a_vehicle_that_is_wrong_itself_is_not_said_to_be_missing(tmp_path: Path) -> None:
    """Who mends the vehicle has mended everything."""
    file = tmp_path / "swarm.yaml"
    section = "communication: {quiet: [{uavs: [alpha]}], mesh: {alpha: tcp/10.0.0.1:7447}}\n"
    file.write_text(f"{REST}{SIMULATED}{ALPHA.replace('sysid: 2', 'sysid: 900')}{section}")
    with pytest.raises(ConfigError) as error:
        load(file, check_config)
    assert [line.split(": ")[1] for line in error.value.lines] == ["vehicles[0].sysid"]


def test_without_any_vehicle_that_alone_is_said(tmp_path: Path) -> None:
    said = troubles(tmp_path, "quiet: [{uavs: [uav1]}]", "planner: {name: dijkstra}\n")
    assert len(said) == 1
    assert "no vehicle: give `simulate: {count: 5}`" in said[0]
