"""A payload that reports its observations to its vehicle's agent, once a second.

Needs `pip install eclipse-zenoh`.
For a flight of this user on this machine, with `sensor: {source: external}`:
python configs/detector.py first-flight 3

For a flight of another user or machine, with its endpoint and the file of SWARMCTL_TOKEN_FILE:
python configs/detector.py first-flight 3 tcp/10.0.0.1:7447 token
"""

import hmac
import json
import os
import sys
import tempfile
import time
from pathlib import Path

import zenoh


def look() -> list[list]:
    """Return [row, col, occupied] of each cell observed since the last call. Replace this."""
    return [[4, 7, True], [4, 8, False]]


def find_flight(swarm: str) -> tuple[str, str]:
    """Return endpoint and token of this user's last flight."""
    folder = Path(tempfile.gettempdir()) / f"swarmctl-{os.getuid()}"
    files = sorted(folder.glob(f"{swarm}.*.json"), key=lambda file: file.stat().st_mtime)
    flights = [entry for entry in map(json.loads, map(Path.read_text, files)) if entry["swarm"] == swarm]
    if not flights:
        sys.exit(f"no flight of {swarm} in {folder}; start it, or give ENDPOINT and TOKEN_FILE")
    return flights[-1]["endpoint"], flights[-1]["token"]


def sign(swarm: str, key: str, report: dict, token: str) -> bytes:
    """Return the signed report; docs/security.md has the format."""
    header = {"key": key, "unix_s": time.time()}
    body = json.dumps(header).encode() + b"\n" + json.dumps(report).encode()
    signed = b"swarmctl request\0" + swarm.encode() + b"\0" + body
    return hmac.digest(token.encode(), signed, "sha512") + body


if len(sys.argv) not in (3, 5):
    sys.exit("expected SWARM SYSTEM_ID [ENDPOINT TOKEN_FILE], such as first-flight 3")
swarm, uav = sys.argv[1:3]
if len(sys.argv) == 5:
    endpoint, token = sys.argv[3], Path(sys.argv[4]).read_text().strip()
else:
    endpoint, token = find_flight(swarm)
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([endpoint]))
config.insert_json5("scouting/multicast/enabled", "false")
try:
    session = zenoh.open(config)
except zenoh.ZError as error:
    reason = str(error).split(" at /")[0]  # without the line of Zenoh's sources
    sys.exit(f"no connection to {endpoint} ({reason}); start the flight")
key = f"swarmctl/{swarm}/uav/{uav}/inform/look/sensor"
with session:
    while True:
        if cells := look():
            report = {"version": 1, "cells": cells, "unix_s": time.time(), "source": "detector"}
            session.put(key, sign(swarm, key, report, token))
        time.sleep(1.0)
