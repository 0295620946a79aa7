"""A fleet under test, served by a thread at the wall clock's pace times the speedup."""

import asyncio
import concurrent.futures
import contextlib
import socket
import threading
import time
import warnings
from collections.abc import Callable
from typing import TypeVar

from sim_vehicle.links.url import parse_url
from sim_vehicle.serving.pace import RealTime
from sim_vehicle.serving.server import Server
from sim_vehicle.testing.rig import Rig

DEADLINE_S = 10.0  # longest wait for the server's thread
WAIT_S = 0.005  # wall time between two checks of a condition
Result = TypeVar("Result")


class ServerThread:
    """A thread that serves the fleet until `stop`; the test's thread accesses the fleet by `call`."""

    def __init__(self, rig: Rig, url: str, speedup: float) -> None:
        self._rig, self._url, self._speedup = rig, url, speedup
        self._opened = threading.Event()
        self._error: BaseException | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._task: asyncio.Task[None] | None = None
        self._server: Server | None = None
        self.lag_warning = ""  # the last warning that the machine was too slow
        self._thread = threading.Thread(target=self._main, name="sim_vehicle", daemon=True)
        self._thread.start()
        if not self._opened.wait(DEADLINE_S):
            raise TimeoutError(f"the server did not open {url} within {DEADLINE_S:g} s")
        if self._error is not None:
            raise self._error

    def _main(self) -> None:
        try:
            asyncio.run(self._serve())
        except BaseException as error:  # noqa: BLE001 (raised again in the test's thread)
            self._error = error
        finally:
            self._opened.set()

    async def _serve(self) -> None:
        self._loop, self._task = asyncio.get_running_loop(), asyncio.current_task()
        self._server = Server(
            self._rig.existing(),
            [parse_url(self._url)],
            RealTime(self._speedup, self._too_slow),
            warn=self._rig.operator_lines.append,
            record=self._rig.take,
        )
        with contextlib.suppress(asyncio.CancelledError):
            await self._server.run(on_open=self._opened.set)

    def _too_slow(self, text: str) -> None:
        self._rig.operator_lines.append(text)
        self.lag_warning = text

    @property
    def now(self) -> float:
        return 0.0 if self._server is None else self._server.simulated_s

    def call(self, function: Callable[[], Result]) -> Result:
        """Run a function between two ticks in the fleet's thread (in this thread if that has ended).

        Returns the result of the function.
        """
        if self._error is not None:
            raise self._error
        if threading.current_thread() is self._thread or not self._thread.is_alive():
            return function()
        assert self._loop is not None
        done: concurrent.futures.Future[Result] = concurrent.futures.Future()

        def run() -> None:
            try:
                done.set_result(function())
            except BaseException as error:  # noqa: BLE001 (passed to the caller)
                done.set_exception(error)

        self._loop.call_soon_threadsafe(run)
        return done.result(DEADLINE_S)

    def sleep_briefly(self) -> None:
        """Sleep for a moment of wall time; raise an error of the thread."""
        time.sleep(WAIT_S)
        if self._error is not None:
            raise self._error

    def stop(self) -> None:
        if self._loop is not None and self._task is not None and self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._task.cancel)
        self._thread.join(DEADLINE_S)
        if self._error is not None:
            raise self._error


class ServedFleet:
    """The served fleet of a test, which starts with the first use of its URL.

    One port carries up to 250 vehicles with different system ids; more vehicles use the following ports.
    """

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._thread: ServerThread | None = None
        self._port = 0

    def serve(self, url: str | None = None, *, speedup: float = 1.0) -> "ServedFleet":
        """Begin to serve; without this call serving begins with the first use of `link.url`.

        Parameters
        ----------
        url: as for `--url`: `udpout:127.0.0.1:14550` for a listening station, `tcpin:127.0.0.1:5760` for a
            connecting station. None: the fleet listens on a free UDP port of this machine and answers every
            sender; `link.url`, `link.mavsdk_url`, `link.address` and `link.port` give this port.
        speedup: simulated seconds per second of wall time. If the machine is too slow, the test ends with a
            RuntimeWarning.
        """
        __tracebackhide__ = True
        if self._thread is not None:
            raise RuntimeError("the fleet is already served; call link.serve() before the use of link.url")
        if url is None:
            self._port = _free_port(1 + max(self._rig.existing().links))
            url = f"udpin:127.0.0.1:{self._port}"
        self._thread = ServerThread(self._rig, url, speedup)
        self._rig.serving = self._thread
        return self

    @property
    def port(self) -> int:
        """The fleet's first UDP port on 127.0.0.1."""
        __tracebackhide__ = True
        if self._thread is None:
            self.serve()
        if not self._port:
            raise RuntimeError(
                "link.port and link.url are unknown after link.serve(url); "
                "use that URL, or call link.serve() without a URL"
            )
        return self._port

    @property
    def address(self) -> tuple[str, int]:
        """The host and port for a socket of the test."""
        __tracebackhide__ = True
        return ("127.0.0.1", self.port)

    @property
    def url(self) -> str:
        """The URL for pymavlink and MAVProxy, which send first; the fleet answers every sender."""
        __tracebackhide__ = True
        return f"udpout:127.0.0.1:{self.port}"

    @property
    def mavsdk_url(self) -> str:
        """The same URL for MAVSDK."""
        __tracebackhide__ = True
        return f"udpout://127.0.0.1:{self.port}"

    def close(self) -> None:
        """Stop the server; warn in the test's thread if the machine was too slow."""
        thread, self._thread = self._thread, None
        if thread is not None:
            thread.stop()
            if thread.lag_warning:
                warnings.warn(thread.lag_warning, RuntimeWarning, stacklevel=2)


def _free_port(count: int) -> int:
    """Return the first of `count` consecutive free UDP ports of 127.0.0.1."""
    for _ in range(100):
        with contextlib.ExitStack() as probes:
            first = _bound_port(probes, 0)
            with contextlib.suppress(OSError):
                for port in range(first + 1, first + count):
                    _bound_port(probes, port)
                return first
    raise OSError(f"127.0.0.1 has no {count} consecutive free UDP ports")


def _bound_port(probes: contextlib.ExitStack, port: int) -> int:
    probe = probes.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    probe.bind(("127.0.0.1", port))
    return int(probe.getsockname()[1])
