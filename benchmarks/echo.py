"""The latency of a Zenoh echo beside a planner that runs all the time in the same process."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable

import numpy as np
import zenoh
from numpy.typing import NDArray
from zenoh.handlers import Callback

ENDPOINT = "tcp/127.0.0.1:17447"
OTHER_SIDE = f"""
import sys, zenoh, json
from zenoh.handlers import Callback
config = zenoh.Config()
config.insert_json5("scouting/multicast/enabled", "false")
config.insert_json5("connect/endpoints", json.dumps(["{ENDPOINT}"]))
with zenoh.open(config) as session:
    back = lambda sample: session.put("bench/pong", bytes(sample.payload))
    session.declare_subscriber("bench/ping", Callback(back, indirect=False))
    print("ready", flush=True)
    sys.stdin.read()
"""


def round_trips_s(count: int, beside: Callable[[], object] | None) -> NDArray[np.float64]:
    """Return the round-trip times of messages to another process, (count,), while a thread calls `beside`."""
    config = zenoh.Config()
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("listen/endpoints", json.dumps([ENDPOINT]))
    back, stop = threading.Event(), threading.Event()
    worker = threading.Thread(target=_again_and_again, args=(beside, stop))
    with zenoh.open(config) as session:

        def on_pong(_: zenoh.Sample) -> None:
            back.set()

        session.declare_subscriber("bench/pong", Callback(on_pong, indirect=False))
        other = subprocess.Popen(
            [sys.executable, "-c", OTHER_SIDE], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        assert other.stdout is not None
        other.stdout.readline()
        time.sleep(0.5)  # until the two know of each other's subscribers
        worker.start()
        taken = []
        for _ in range(count):
            began_s = time.perf_counter()
            session.put("bench/ping", b"x")
            assert back.wait(5.0), "no echo within 5 s"
            back.clear()
            taken.append(time.perf_counter() - began_s)
            time.sleep(0.001)
        stop.set()
        worker.join()
        other.communicate()
    return np.array(taken)


def _again_and_again(beside: Callable[[], object] | None, stop: threading.Event) -> None:
    while beside is not None and not stop.is_set():
        beside()
