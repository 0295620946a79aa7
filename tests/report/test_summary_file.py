"""The numbers of `summary.json`."""

from __future__ import annotations

from swarmctl.report.outputs import rounded


def test_numbers_are_rounded_by_the_unit_in_their_names() -> None:
    content = {
        "flown_m": 1141.3382418840888,
        "rms_error_m": {"along": 1.1570553720595076, "height": None},
        "latency": {"observation_to_mission_s": {"n": 3, "p50": 5.800000000000001}},
        "shortest_s": 0.00041234,
        "safety_factor": 0.00027412345678,
        "vehicles": [{"led_s": {"uav2": 1.6000000000000014}, "name": "uav1"}],
    }
    assert rounded(content) == {
        "flown_m": 1141.34,
        "rms_error_m": {"along": 1.16, "height": None},
        "latency": {"observation_to_mission_s": {"n": 3, "p50": 5.8}},
        "shortest_s": 0.000412,
        "safety_factor": 0.000274123,
        "vehicles": [{"led_s": {"uav2": 1.6}, "name": "uav1"}],
    }
