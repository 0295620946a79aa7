"""The latency of a Zenoh echo while another thread of the process computes without a pause."""

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
ECHO_PROCESS = f"""
import sys, zenoh, json
from zenoh.handlers import Callback
config = zenoh.Config()
config.insert_json5("scouting/multicast/enabled", "false")
config.insert_json5("connect/endpoints", json.dumps(["{ENDPOINT}"]))
with zenoh.open(config) as session:
    reply = lambda sample: session.put("bench/pong", bytes(sample.payload))
    session.declare_subscriber("bench/ping", Callback(reply, indirect=False))
    print("ready", flush=True)
    sys.stdin.read()
"""
DISCOVERY_S = 0.5
"""time for both sessions to learn the subscribers of the other"""


def round_trips_s(count: int, background_task: Callable[[], object] | None) -> NDArray[np.float64]:
    """Return the round-trip times of messages to another process, (count,) [s].

    background_task: a thread calls it repeatedly during the measurement; None: no thread computes.
    """
    config = zenoh.Config()
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("listen/endpoints", json.dumps([ENDPOINT]))
    returned, stop = threading.Event(), threading.Event()
    worker = threading.Thread(target=_repeat, args=(background_task, stop))
    with zenoh.open(config) as session:

        def on_pong(_sample: zenoh.Sample) -> None:
            returned.set()

        session.declare_subscriber("bench/pong", Callback(on_pong, indirect=False))
        echo_process = subprocess.Popen(
            [sys.executable, "-c", ECHO_PROCESS], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        assert echo_process.stdout is not None
        echo_process.stdout.readline()
        time.sleep(DISCOVERY_S)
        worker.start()
        times_s = []
        for _ in range(count):
            began_s = time.perf_counter()
            session.put("bench/ping", b"x")
            assert returned.wait(5.0), "no echo within 5 s"
            returned.clear()
            times_s.append(time.perf_counter() - began_s)
            time.sleep(0.001)
        stop.set()
        worker.join()
        echo_process.communicate()
    return np.array(times_s)


def _repeat(task: Callable[[], object] | None, stop: threading.Event) -> None:
    while task is not None and not stop.is_set():
        task()
