"""Every message and every command with extreme fields: the fleet survives and answers."""

import random

import pytest
from fuzz_attacks import ATTACKS, launch
from fuzz_bench import CRAFT, Bench

PLACES = ("on the ground, uploading", "in flight, signing")
CONVERSATIONS = ("missions", "flown_missions", "files", "written_files", "logs", "flown_logs")


def bench_at(name: str, kind: str, place: str) -> Bench:
    bench = Bench(name, kind)
    if place == PLACES[0]:
        bench.begin_upload()
    else:
        bench.fly()
        bench.sign()
    return bench


@pytest.mark.parametrize("attack", [attack for attack in ATTACKS if attack not in CONVERSATIONS])
@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize(("name", "kind"), CRAFT)
def test_messages(name: str, kind: str, place: str, attack: str) -> None:
    bench = bench_at(name, kind, place)
    launch(bench, ATTACKS[attack], random.Random(f"{name} {kind} {place} {attack}"))
    bench.check()


@pytest.mark.parametrize("attack", CONVERSATIONS)
@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize(("name", "kind"), CRAFT)
def test_conversations(name: str, kind: str, place: str, attack: str) -> None:
    bench = bench_at(name, kind, place)
    launch(bench, ATTACKS[attack], random.Random(f"{name} {kind} {place} {attack}"))
    bench.check()
