"""Errors in the section `communication` are reported at their keys, before anything starts."""

from __future__ import annotations

from pathlib import Path

import pytest
from config_files import ALPHA, SIMULATED, SMALL_AREA, assert_problems, problems, section_problems

MESH = "mesh: {uav1: tcp/10.0.0.1:7447, uav2: tcp/10.0.0.2:7447, uav3: tcp/10.0.0.3:7447}"


def troubles(communication: str, tmp_path: Path, vehicles: str = SIMULATED) -> list[str]:
    return section_problems("communication", communication, vehicles, tmp_path)


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
    "keys: keys",
    "keys: keys, listen: none",
    "keys: keys, bus: memory, listen: tcp/localhost:0",
    "keys: keys, router: tls/10.0.0.9:7447",
    "keys: k, mesh: {1: quic/10.0.0.1:7447, 2: tls/10.0.0.2:7447, 3: tls/10.0.0.3:7447}",
]


@pytest.mark.parametrize("communication", RIGHT)
def test_a_correct_section_has_no_problems(communication: str, tmp_path: Path) -> None:
    assert troubles(communication, tmp_path) == []


ROWS: list[tuple[str, str, list[tuple[str, ...]]]] = [
    ("bursts too short for the share", "loss: 0.9, loss_burst: 1", [("loss_burst", "0.9", "9")]),
    (
        "bursts too short, with a remedy that is rounded to be accepted",
        "loss: 0.6, loss_burst: 1.3",
        [("loss_burst", "1.3", "0.6", "1.5")],
    ),
    ("bursts without losses", "loss_burst: 3", [("", "loss_burst")]),
    ("an exchange faster than the delay", "delay_s: 5", [("sync_every_s", "3", "delay_s = 5", "5 or more")]),
    (
        "a minimum distance above the maximum",
        "min_distance_m: 500, max_distance_m: 400",
        [("", "min_distance_m 500", "max_distance_m 400")],
    ),
    (
        "groups with unknown vehicles",
        "partitions: [{from_s: 0, groups: [[uav1], [uav4, 9]]}]",
        [
            ("partitions[0].groups[1][0]", "uav4", "1 (uav1), 2 (uav2), 3 (uav3)"),
            ("partitions[0].groups[1][1]", "9", "1 (uav1), 2 (uav2), 3 (uav3)"),
        ],
    ),
    (
        "one vehicle in two groups, by name and by system id",
        "partitions: [{from_s: 0, groups: [[uav1, uav2], [2, uav3]]}]",
        [("partitions[0].groups[1][0]", "uav2")],
    ),
    ("an empty group", "partitions: [{from_s: 0, groups: [[1], []]}]", [("partitions[0]",)]),
    (
        "a partition that ends before it begins",
        "partitions: [{from_s: 9, until_s: 5, groups: [[uav1]]}]",
        [("partitions[0]", "until_s 5", "from_s 9")],
    ),
    (
        "a quiet time that ends as it begins",
        "quiet: [{uavs: [1], from_s: 9, until_s: 9}]",
        [("quiet[0]", "until_s 9", "from_s 9")],
    ),
    (
        "a quiet time with an unknown vehicle, and with one twice",
        "quiet: [{uavs: [alpha, uav1, 1]}]",
        [("quiet[0].uavs[0]", "alpha", "1 (uav1)"), ("quiet[0].uavs[2]", "uav1")],
    ),
    ("a mesh without two vehicles", "mesh: {uav2: tcp/10.0.0.2:7447}", [("mesh", "uav1, uav3")]),
    (
        "a mesh with one too many",
        f"{MESH[:-1]}, uav4: tcp/10.0.0.4:7447}}",
        [("mesh.uav4", "uav4", "3 (uav3)")],
    ),
    ("a mesh with one twice", f"{MESH[:-1]}, 3: tcp/10.0.0.4:7447}}", [("mesh.3", "uav3")]),
    (
        "two vehicles at one endpoint",
        "mesh: {uav1: tcp/10.0.0.1:7447, uav2: tcp/10.0.0.2:7447, uav3: tcp/10.0.0.1:7447}",
        [("mesh.uav3", "tcp/10.0.0.1:7447", "uav1")],
    ),
    ("an address of all interfaces", "router: tcp/0.0.0.0:7447", [("router", "'tcp/0.0.0.0:7447'")]),
    (
        "any free port",
        "mesh: {uav1: tcp/10.0.0.1:0, uav2: tcp/10.0.0.2:7447, uav3: tcp/10.0.0.3:7447}",
        [("mesh.uav1", "'tcp/10.0.0.1:0'")],
    ),
    ("a star and a mesh", f"router: tcp/10.0.0.9:7447, {MESH}", [("", "router", "mesh")]),
    ("a star within one process", "bus: memory, router: tcp/10.0.0.9:7447", [("router", "bus: zenoh")]),
    (
        "keys that do not protect the endpoint",
        "keys: keys, listen: tcp/0.0.0.0:7447",
        [("listen", "tcp/0.0.0.0:7447", "communication.keys", "tcp/127.0.0.1:0")],
    ),
    (
        "keys that the router does not use",
        "keys: keys, router: tcp/10.0.0.9:7447",
        [("router", "tcp/10.0.0.9:7447", "communication.keys", "tls/")],
    ),
    (
        "a router with certificates and no keys",
        "router: tls/10.0.0.9:7447",
        [("router", "tls/10.0.0.9:7447", "communication.keys", "`swarmctl keys`")],
    ),
    (
        "a flight that listens with certificates",
        "listen: tls/10.0.0.9:7447",
        [("listen", "tls/10.0.0.9:7447", "tcp/HOST:PORT")],
    ),
    (
        "one node of the mesh without certificates",
        "keys: k, mesh: {1: quic/10.0.0.1:7447, 2: tcp/10.0.0.2:7447, 3: tls/10.0.0.3:7447}",
        [("mesh.2", "tcp/10.0.0.2:7447", "communication.keys", "tls/")],
    ),
]


@pytest.mark.parametrize(
    ("communication", "expected"), [row[1:] for row in ROWS], ids=[row[0] for row in ROWS]
)
def test_an_error_is_reported_at_its_key(
    communication: str, expected: list[tuple[str, ...]], tmp_path: Path
) -> None:
    assert_problems(troubles(communication, tmp_path), expected)


def test_vehicles_with_a_url_are_named_by_name_and_by_system_id(tmp_path: Path) -> None:
    named = "quiet: [{uavs: [alpha]}], partitions: [{from_s: 0, groups: [[2]]}]"
    assert troubles(named, tmp_path, ALPHA) == []
    found = troubles("quiet: [{uavs: [uav2]}]", tmp_path, ALPHA)
    assert_problems(found, [("quiet[0].uavs[0]", "uav2", "2 (alpha)")])


def test_a_name_that_matches_two_vehicles_is_refused(tmp_path: Path) -> None:
    vehicles = ALPHA.replace("alpha", '"1"') + "simulate: {count: 1}\n"
    found = problems(f"{SMALL_AREA}{vehicles}communication: {{quiet: [{{uavs: [1]}}]}}\n", tmp_path)
    assert_problems(found, [(":5: communication.quiet[0].uavs[0]", "1 (uav1)", "2 (1)")])


def test_a_vehicle_with_an_error_is_not_reported_as_missing(tmp_path: Path) -> None:
    """A correction of the vehicle's entry removes all these problems."""
    section = "communication: {quiet: [{uavs: [alpha]}], mesh: {alpha: tcp/10.0.0.1:7447}}\n"
    found = problems(f"{SMALL_AREA}{SIMULATED}{ALPHA.replace('sysid: 2', 'sysid: 900')}{section}", tmp_path)
    assert [line.split(": ")[1] for line in found] == ["vehicles[0].sysid"]


def test_without_vehicles_only_their_absence_is_reported(tmp_path: Path) -> None:
    (found,) = troubles("quiet: [{uavs: [uav1]}]", tmp_path, "planner: {name: dijkstra}\n")
    assert ": vehicles: " in found
    assert "`simulate: {count: 5}`" in found
