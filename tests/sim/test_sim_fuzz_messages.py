"""Every message and every command with extreme fields: the fleet survives and answers."""

import random

import pytest
from fuzz_attacks import ATTACKS, launch
from fuzz_bench import CRAFT, Bench

GROUND, AIR = "on the ground, uploading", "in flight, signing"
# The short run launches each attack once.
SHORT_RUN = {
    "any_message": ("px4", "copter", AIR),
    "flown_missions": ("ardupilot", "plane", AIR),
    "commands": ("ardupilot", "plane", AIR),
    "likely_commands": ("px4", "plane", AIR),
    "setpoints": ("ardupilot", "copter", AIR),
}
CASES = [
    pytest.param(*case, attack, marks=() if case == SHORT_RUN[attack] else pytest.mark.full)
    for attack in ATTACKS
    for place in (GROUND, AIR)
    for case in [(*craft, place) for craft in CRAFT]
]


def bench_at(name: str, kind: str, place: str) -> Bench:
    bench = Bench(name, kind)
    if place == GROUND:
        bench.begin_upload()
    else:
        bench.fly()
        bench.sign()
    return bench


@pytest.mark.parametrize(("name", "kind", "place", "attack"), CASES)
def test_the_fleet_survives_an_attack(name: str, kind: str, place: str, attack: str) -> None:
    bench = bench_at(name, kind, place)
    launch(bench, ATTACKS[attack], random.Random(f"{name} {kind} {place} {attack}"))
    bench.check()
