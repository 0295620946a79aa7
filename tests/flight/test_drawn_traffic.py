"""A campaign of drawn traffic with light vehicles: no breach of the limits, no deadlock, no wait without end.

`--drawn-traffic 1000` flies that many seeds; docs/limits.md has what was flown.
"""

from __future__ import annotations

import pytest
from drawn_traffic import draw

N_DEFAULT, N_FULL = 12, 50

FOUND = {
    171: "a vehicle three metres below another one began to climb",
    29: "a vehicle that held below a landing one waited for it, and the other way round",
    64: "a new any-angle route from a lattice route ended the program with an IndexError",
    73: "a vehicle climbed over its goal through the height of a landing one",
    103: "two vehicles changed their heights over one goal",
    112: "a vehicle held in its climb, in the way of the next one",
    546: "two landing vehicles met over the goal's centre, and neither was allowed to hold any more",
    118: "a vehicle gave way to a landing one with a climb that ended over the goal",
    218: "a vehicle with a higher speed followed another one to the goal, and neither had an alarm",
    312: "an ordered landing came down beside a landing vehicle",
    139: "a vehicle passed a silent one that landed beside the goal's centre",
    287: "a vehicle that braked was expected to fly straight on, and another one flew into its hold",
    892: "a vehicle stopped in its climb for one that the climb would have passed",
    617: "a return that waited below a landing vehicle climbed through it at its deadline",
    657: "a vehicle landed through the height of one that was mute for 30 s",
    377: "a vehicle landed where one, mute for 30 s, had stopped on its way",
    500: "a vehicle, mute for 30 s, changed to the height of another one",
    538: "a vehicle landed beside one, mute for 30 s, that had stopped before its landing",
    975: "a vehicle went on from its hold, just when the others did not hear it any more",
    490: "a vehicle took off while it heard no other vehicle",
    314: "a vehicle, ordered to return from its descent, climbed into the way of one that came to the goal",
    58: "a vehicle did not stop for one in its way, because another one followed it",
    195: "a vehicle stopped past its next waypoint and flew back, other than announced",
    963: "an alarm ended each flight that the trajectory check had found clear",
    641: "a vehicle with priority came from behind upon a vehicle that gave way but could not",
    337: "a vehicle stopped above another one, and an urgent landing began at once",
    788: "a vehicle that took no commands for 2 s got no second order to hold",
    191: "an ordered landing descended through a vehicle that another station held",
}
"""seeds that broke a rule before, with the cause"""

FOUND_IN_FULL_RUNS = {
    368: "a vehicle that was mute for some seconds did not fly as it had announced",
    609: "a vehicle waited before its landing in the way of one that was mute for 30 s",
    646: "a vehicle that was mute for some seconds did not fly as it had announced",
    740: "a vehicle that was mute for some seconds did not fly as it had announced",
    893: "a vehicle that was mute for some seconds did not fly as it had announced",
    916: "a vehicle that was mute for some seconds did not fly as it had announced",
    10: "a vehicle that sped up was thought to be able to stop",
    679: "past a corner where its route turned back, a vehicle announced the leg before the corner",
    142: "two vehicles drifted over neighbouring landing spots, and held and resumed in turns",
    432: "as 142",
    150: "a landing vehicle stopped nearer to another one than its landing spot is",
    310: "after a late mission change, changes were announced too late",
    961: "a vehicle that had stopped on its route waited again before its landing, in the way of a lost link",
    852: "two vehicles went on from their holds within a second",
    644: "a return from a low hold passed over a vehicle, for it did not climb as high as expected",
    166: "two vehicles stood near each other for minutes, and neither climbed",
    381: "the one message of a flight without a link was lost, and a vehicle held in its way",
    566: "a vehicle beside its route announced a stop at its next waypoint",
}
"""larger swarms; each flight takes up to 13 s"""


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "seed" in metafunc.fixturenames:
        is_full, n = metafunc.config.getoption("--full"), metafunc.config.getoption("--drawn-traffic")
        seeds = {*range(n or (N_FULL if is_full else N_DEFAULT)), *FOUND}
        metafunc.parametrize("seed", sorted(seeds | {*(FOUND_IN_FULL_RUNS if is_full else ())}))


def test_drawn_traffic_keeps_its_limits_and_ends_every_wait(seed: int) -> None:
    drawn = draw(seed).flown()
    assert drawn.findings == [], drawn.story
