"""`python -m sim_vehicle` as a process, its sockets and serial devices, and a short ground station for it."""

import os
import select
import socket
import subprocess
import sys
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.station.frames import Receiver
from sim_vehicle.station.messages import command_long

LIMIT_S = 20.0


def only_late(errors_text: str) -> bool:
    """Return True if all warnings are about lost time on a slow machine."""
    return all("[too-slow]" in line for line in errors_text.splitlines())


@contextmanager
def simulator(
    *arguments: str, errors: Callable[[str], bool] | None = None, before: str = ""
) -> Iterator[Any]:
    """Run the simulator during the block; require exit code 0 and only warnings that pass `errors`.

    `before`: a shell command before the start.
    """
    own = ("--ready-s", "1", "--parent-pid", str(os.getpid()))  # ends with the tests
    command = shell(before, *own, *arguments)
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        yield process
    finally:
        process.terminate()
        _, errors_text = process.communicate(timeout=LIMIT_S)
    assert process.returncode == 0, errors_text
    assert (errors or only_late)(errors_text), errors_text


def shell(before: str, *arguments: str) -> list[str]:
    """Return the command, in a shell that runs `before` if it is given."""
    command = [sys.executable, "-m", "sim_vehicle", *arguments]
    return ["sh", "-c", f'{before}; exec "$@"', "sh", *command] if before else command


def run(*arguments: str, before: str = "", steps: str = "") -> subprocess.CompletedProcess[str]:
    """Run the simulator to its end, with `steps` on standard input."""
    return subprocess.run(
        shell(before, *arguments),
        input=steps, capture_output=True, text=True, timeout=LIMIT_S, check=False,
    )  # fmt: skip


def line(process: Any) -> str:
    """Return the next line of standard output; fail without one. Lines must be read one at a time."""
    assert select.select([process.stdout], [], [], LIMIT_S)[0], f"no line within {LIMIT_S} s"
    return str(process.stdout.readline())


def udp_socket(port: int = 0) -> tuple[socket.socket, int]:
    udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    udp.bind(("127.0.0.1", port))
    udp.settimeout(LIMIT_S)
    return udp, udp.getsockname()[1]


def free_udp_port() -> int:
    probe, port = udp_socket()
    probe.close()
    return port


def udp_sockets(count: int) -> list[socket.socket]:
    """Return sockets bound to consecutive ports."""
    for _ in range(100):
        first, port = udp_socket()
        opened = [first]
        try:
            opened += [udp_socket(port + i)[0] for i in range(1, count)]
        except (OSError, OverflowError):
            for udp in opened:
                udp.close()
        else:
            return opened
    raise AssertionError(f"no {count} consecutive free ports")


def free_tcp_port(count: int = 1, step: int = 1) -> int:
    """Return the first of `count` free ports that are `step` apart."""
    for _ in range(100):
        probes: list[socket.socket] = []
        try:
            probes.append(socket.create_server(("127.0.0.1", 0)))
            port = int(probes[0].getsockname()[1])
            probes += [socket.create_server(("127.0.0.1", port + i * step)) for i in range(1, count)]
        except (OSError, OverflowError):
            continue
        else:
            return port
        finally:
            for probe in probes:
                probe.close()
    raise AssertionError(f"no {count} free ports {step} apart")


class SerialDevice:
    """A pseudo-terminal behind the symbolic link `name`.

    Another test may reuse the number of a closed terminal; a separate link avoids a mix-up.
    """

    def __init__(self, name: Path) -> None:
        self.name = name
        self._ends: tuple[int, ...] = ()

    def plug_in(self) -> int:
        """Connect a new terminal and return the test's end."""
        own_end, device_end = self._ends = os.openpty()
        tty.setraw(own_end)
        tty.setraw(device_end)
        self.name.symlink_to(os.ttyname(device_end))
        return own_end

    def pull(self) -> None:
        self.name.unlink()  # before the close, so that the number is not found
        for end in self._ends:
            os.close(end)


class Ground:
    """A ground station on a socket or file; every wait has a time-out."""

    def __init__(self, source: Any, address: Any = None, *, sysid: int = 255) -> None:
        self._source, self.address = source, address
        self.codec = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=190)
        self._receiver = Receiver()
        self.received: list[Any] = []
        self.raw = b""

    def __enter__(self) -> "Ground":
        return self

    def __exit__(self, *_: object) -> None:
        self._source.close()

    def _read(self, until_s: float) -> None:
        left_s = until_s - time.monotonic()
        file = self._source if isinstance(self._source, int) else self._source.fileno()
        if left_s <= 0 or not select.select([file], [], [], left_s)[0]:
            kinds = sorted({m.get_type() for m in self.received})
            raise AssertionError(f"not within {LIMIT_S} s; received {kinds}")
        if isinstance(self._source, int):
            data = os.read(self._source, 65_536)
        elif self._source.type == socket.SOCK_DGRAM:
            data, self.address = self._source.recvfrom(65_536)
        else:
            data = self._source.recv(65_536)
            if not data:
                raise ConnectionError("closed by the simulator")
        self.raw += data
        self.received += self._receiver.messages(data)

    def until(self, condition: Callable[[Any], bool]) -> Any:
        """Return the next message that satisfies a condition."""
        end_s = time.monotonic() + LIMIT_S
        begin = len(self.received)
        while True:
            for message in self.received[begin:]:
                if condition(message):
                    return message
            begin = len(self.received)
            self._read(end_s)

    def systems(self, *sysids: int) -> None:
        """Wait for a heartbeat of each of these systems."""
        missing = set(sysids)

        def is_last(message: Any) -> bool:
            if message.get_type() == "HEARTBEAT":
                missing.discard(message.get_srcSystem())
            return not missing

        self.until(is_last)

    @property
    def received_systems(self) -> set[int]:
        return {m.get_srcSystem() for m in self.received if m.get_type() == "HEARTBEAT"}

    def send(self, message: Any, address: Any = None) -> None:
        self.send_raw(message.pack(self.codec), address)

    def send_raw(self, data: bytes, address: Any = None) -> None:
        if isinstance(self._source, int):
            os.write(self._source, data)
        elif self._source.type == socket.SOCK_DGRAM:
            self._source.sendto(data, address or self.address)
        else:
            self._source.sendall(data)

    def answered(self, ts1: int, target: int, address: Any = None) -> Any:
        """Send a TIMESYNC request and wait for the answer of one vehicle."""
        self.send(mavlink.MAVLink_timesync_message(0, ts1), address)
        return self.until(
            lambda m: m.get_type() == "TIMESYNC" and m.ts1 == ts1 and m.tc1 and m.get_srcSystem() == target
        )

    def reboot(self, target: int) -> None:
        self.send(command_long((target, 0), mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1))
