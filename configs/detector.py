"""A payload that reports its observations to its vehicle's agent, once a second.

Needs `pip install eclipse-zenoh`.
For a swarm with `sensor: {source: external}` and `communication: {listen: tcp/127.0.0.1:7447}`:
python configs/detector.py tcp/127.0.0.1:7447 first-flight 3
"""

import json
import sys
import time

import zenoh


def look() -> list[list]:
    """Return [row, col, occupied] of each cell observed since the last call. Replace this."""
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
    reason = str(error).split(" at /")[0]  # without the line of Zenoh's sources
    sys.exit(f"no connection to {endpoint} ({reason}); start the flight with that communication.listen")
with session:
    while True:
        if cells := look():
            report = {"version": 1, "cells": cells, "unix_s": time.time(), "source": "detector"}
            session.put(f"swarmctl/{swarm}/uav/{uav}/inform/look/sensor", json.dumps(report))
        time.sleep(1.0)
