"""Process exit while a thread is blocked inside Zenoh, for seconds or for ever.

Such a thread is a daemon, so the thread does not keep the process alive. But if the thread returns from Zenoh
during the interpreter's shutdown, Python ends the thread inside native code, and the process dies of SIGABRT.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable
from typing import NoReturn

_started: list[threading.Thread] = []


def start_thread(name: str, run: Callable[[], None]) -> threading.Thread:
    """Start a thread that may be inside Zenoh when the process ends."""
    _started[:] = [thread for thread in _started if thread.is_alive()]
    thread = threading.Thread(target=run, name=name, daemon=True)
    _started.append(thread)
    thread.start()
    return thread


def has_live_thread() -> bool:
    """Return whether a thread of `start_thread` is alive."""
    return any(thread.is_alive() for thread in _started)


def exit_process(code: int) -> NoReturn:
    """End the process with `code`: normally, or at once if a thread of `start_thread` is alive."""
    if not has_live_thread():
        sys.exit(code)
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    os._exit(code)
