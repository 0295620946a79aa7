"""A payload that tells its vehicle's agent what it sees, once a second. Needs `pip install eclipse-zenoh`.

For a swarm with `sensor: {source: external}` and `communication: {listen: tcp/127.0.0.1:7447}`:
python configs/detector.py tcp/127.0.0.1:7447 first-flight 3
"""

import json
import sys
import time

import zenoh


def look() -> list[list]:
    """Replace this: [row, col, occupied] of each cell that was seen since the last time."""
    return [[4, 7, True], [4, 8, False]]


if len(sys.argv) != 4:
    sys.exit("expected ENDPOINT SWARM SYSTEM_ID, such as tcp/127.0.0.1:7447 first-flight 3")
endpoint, swarm, uav = sys.argv[1:]
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([endpoint]))
config.insert_json5("scouting/multicast/enabled", "false")
try:
    session = zenoh.open(config)
except zenoh.ZError as error:
    why = str(error).split(" at /")[0]  # without the place in Zenoh's sources
    sys.exit(f"nobody lets us in at {endpoint}: does the flight run, with that communication.listen? ({why})")
with session:
    while True:
        if cells := look():
            report = {"version": 1, "cells": cells, "unix_s": time.time(), "source": "detector"}
            session.put(f"swarmctl/{swarm}/uav/{uav}/inform/look/sensor", json.dumps(report))
        time.sleep(1.0)
