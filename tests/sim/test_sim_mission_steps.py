"""The order in which both autopilots execute a mission, with a pilot that only records."""

import pytest
from transfer_bench import IdlePilot, px4_mission

from sim_vehicle.vehicle.mission import Item, Mission, MissionState
from sim_vehicle.vehicle.mission_px4 import Px4Mission

TAKEOFF, WP, LAND, NAV_DELAY = 22, 16, 21, 93
SPEED, JUMP, DELAY, DISTANCE, YAW, LAND_START = 178, 177, 112, 114, 115, 189


def jump(to: int, times: int) -> Item:
    return Item(JUMP, param1=to, param2=times)


def px4(*items: Item) -> tuple[Px4Mission, IdlePilot]:
    mission, pilot = px4_mission(), IdlePilot()
    mission.replace(pilot, items)
    return mission, pilot


def ardupilot(*items: Item) -> tuple[Mission, IdlePilot]:
    mission, pilot = Mission(home=lambda: Item(WP)), IdlePilot()
    for index, kept in enumerate([Item(WP), *items]):
        mission.put(index, kept)
    return mission, pilot


def fly(mission: Mission, pilot: IdlePilot, *, steps: int = 100) -> list[int]:
    """Arm, fly until the mission is complete, and return the reached indices."""
    pilot.armed = True
    mission.start_or_resume(pilot)
    for step in range(steps):
        pilot.arrived = step % 2 == 1
        mission.update(pilot, float(step))
        if mission.state is MissionState.COMPLETE:
            break
    return reached(pilot)


def reached(pilot: IdlePilot) -> list[int]:
    return [index for event, index in pilot.log if event == "reached"]


def test_px4_reaches_and_reports_every_item() -> None:
    mission, pilot = px4(Item(TAKEOFF), Item(SPEED), Item(SPEED), Item(WP), Item(LAND))
    assert fly(mission, pilot) == [0, 1, 2, 3, 4]
    assert mission.index == 4
    assert pilot.log[-1] == ("ended", -1)


def test_px4_jumps_are_not_current_and_their_counts_restart_after_the_end() -> None:
    mission, pilot = px4(Item(TAKEOFF), Item(WP), Item(WP), jump(1, 2), Item(WP))
    assert fly(mission, pilot) == [0, 1, 2, 1, 2, 1, 2, 4]
    mission.reset()
    pilot.log.clear()
    assert fly(mission, pilot) == [0, 1, 2, 1, 2, 1, 2, 4]


def test_px4_moves_nothing_while_disarmed_and_begins_when_armed() -> None:
    mission, pilot = px4(Item(TAKEOFF), Item(SPEED), Item(WP))
    mission.start_or_resume(pilot)
    mission.update(pilot, 0.0)
    assert pilot.log == []
    pilot.armed = True
    mission.update(pilot, 1.0)
    assert pilot.log == [("started", 0), ("fly", WP)]  # a climb in place, then a waypoint


def test_px4_keeps_its_index_over_a_mode_change_until_the_mission_is_complete() -> None:
    mission, pilot = px4(Item(TAKEOFF), Item(WP), Item(WP), Item(LAND))
    fly(mission, pilot, steps=4)
    assert mission.index == 2
    mission.stop()
    mission.reset()  # landed and disarmed somewhere else
    mission.start_or_resume(pilot)
    assert mission.index == 2
    fly(mission, pilot)
    assert mission.index == 3
    mission.start_or_resume(pilot)  # still in the air: the mission is complete
    assert pilot.log[-1] == ("no mission", -1)
    mission.stop()
    mission.reset()
    mission.start_or_resume(pilot)
    assert (mission.index, mission.state) == (0, MissionState.ACTIVE)


def test_px4_starts_a_new_mission_after_a_flight_at_the_kept_or_requested_index() -> None:
    mission, pilot = px4(Item(TAKEOFF), Item(WP), Item(LAND))
    fly(mission, pilot)
    pilot.armed = False
    mission.reset()
    mission.replace(pilot, [Item(TAKEOFF, z=9.0), Item(WP), Item(LAND)])
    pilot.armed = True
    mission.update(pilot, 1.0)
    assert mission.current_item == Item(LAND)
    pilot.armed = False
    mission.reset()
    assert mission.set_current(pilot, 1)
    pilot.armed = True
    mission.update(pilot, 2.0)
    assert (mission.index, mission.current_item) == (1, Item(WP))


def test_px4_stays_at_an_item_without_autocontinue() -> None:
    mission, pilot = px4(Item(TAKEOFF), Item(WP, autocontinue=False), Item(WP))
    assert fly(mission, pilot) == [0, 1]
    assert mission.state is MissionState.ACTIVE
    assert mission.set_current(pilot, 2)
    assert mission.index == 2


def test_px4_waits_for_a_delay_and_a_turn() -> None:
    mission, pilot = px4(Item(DELAY, param1=5.0), Item(YAW), Item(WP))
    pilot.armed = True
    mission.start_or_resume(pilot)
    mission.update(pilot, 10.0)
    mission.update(pilot, 14.9)
    assert mission.index == 0
    assert mission.waiting
    mission.update(pilot, 15.0)
    assert mission.index == 1
    pilot.arrived = True
    mission.update(pilot, 15.1)
    assert mission.index == 2


@pytest.mark.autopilots("2 re-upload in AUTO", "2 CLEAR_ALL", of="px4")
def test_px4_in_flight_continues_a_new_mission_and_ends_at_an_empty_one() -> None:
    mission, pilot = px4(*[Item(WP)] * 6)
    fly(mission, pilot, steps=6)
    assert mission.index == 3
    mission.replace(pilot, [Item(TAKEOFF), *[Item(WP, z=9.0)] * 4])
    assert pilot.log[-2:] == [("started", 3), ("fly", WP)]
    assert mission.current_item == Item(WP, z=9.0)
    mission.replace(pilot, [])
    assert pilot.log[-1] == ("no mission", -1)
    assert mission.index == 0


def test_px4_flies_no_infeasible_mission() -> None:
    pilot = IdlePilot()
    mission = px4_mission(lambda items: all(item.z < 100 for item in items))
    mission.replace(pilot, [Item(WP, z=200.0)])
    fly(mission, pilot)
    assert pilot.log == [("no mission", -1)]
    mission.replace(pilot, [Item(WP, z=20.0)])
    assert mission.set_current(pilot, 0)
    assert pilot.log[-1] == ("fly", WP)


@pytest.mark.parametrize("bad", [jump(9, 1), jump(0, -1)], ids=["target after the end", "endless to itself"])
def test_px4_survives_invalid_jumps(bad: Item) -> None:
    mission, pilot = px4(bad, Item(WP))
    fly(mission, pilot)
    assert mission.state in (MissionState.COMPLETE, MissionState.ACTIVE)


def test_ardupilot_runs_do_commands_beside_the_next_leg_and_reports_them() -> None:
    mission, pilot = ardupilot(Item(TAKEOFF), Item(SPEED), Item(DELAY, param1=3.0), Item(SPEED), Item(WP))
    mission.start_or_resume(pilot)
    pilot.arrived = True
    mission.update(pilot, 0.0)
    assert mission.index == 5
    pilot.arrived = False
    for second in range(1, 6):
        mission.update(pilot, float(second))
    assert reached(pilot) == [1, 2, 3, 4]
    assert [event for event in pilot.log if event[0] in ("fly", "do")] == [
        ("fly", TAKEOFF),
        ("fly", WP),
        ("do", SPEED),
        ("do", DELAY),
        ("do", SPEED),
    ]


def test_ardupilot_waits_for_a_distance_until_the_next_command() -> None:
    mission, pilot = ardupilot(Item(TAKEOFF), Item(DISTANCE, param1=20.0), Item(SPEED), Item(WP), Item(WP))
    mission.start_or_resume(pilot)
    pilot.arrived = True
    mission.update(pilot, 0.0)
    pilot.arrived = False
    mission.update(pilot, 1.0)
    assert mission.waiting
    assert ("do", SPEED) not in pilot.log
    mission.set_current(pilot, 5)
    assert not mission.waiting


def test_ardupilot_begins_only_the_first_do_command_after_the_last_leg() -> None:
    mission, pilot = ardupilot(Item(TAKEOFF), Item(SPEED, param1=1), Item(SPEED, param1=2))
    fly(mission, pilot)
    assert [event for event in pilot.log if event[0] == "do"] == [("do", SPEED)]
    assert mission.state is MissionState.COMPLETE


def test_the_nearest_landing_sequence_is_found() -> None:
    mission, _ = ardupilot(
        Item(TAKEOFF),
        Item(LAND_START),
        Item(WP, x=100),
        Item(LAND_START, x=40),
        Item(LAND, x=50),
        Item(LAND_START),
    )
    assert mission.land_start((90e-7, 0.0)) == 2
    assert mission.land_start((30e-7, 0.0)) == 4
    assert ardupilot(Item(WP))[0].land_start((0.0, 0.0)) is None
