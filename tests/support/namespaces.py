"""Network namespaces on bridges, with processes in them, as machines for tests.

A namespace lives as long as the process that holds it. That process ends when its standard input is closed,
so also when the tests are killed. The namespace of the tests is not changed.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import os
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

HOLD = "echo held; exec cat"
TOOLS = ("ip", "nsenter", "setpriv", "unshare")
POLL_S = 0.05
LIMIT_S = 240.0
"""limit of a wait; many programs share few cores, so a shorter one would measure the load of the machine"""
CLONE_NEWNET = 0x40000000
"""of Linux's setns()"""


def until(true: Callable[[], object], what: Callable[[], str], within_s: float = LIMIT_S) -> None:
    """Wait for a condition that other processes bring about."""
    end_s = time.monotonic() + within_s
    while not true():
        assert time.monotonic() < end_s, f"not within {within_s:g} s: {what()}"
        time.sleep(POLL_S)


@functools.cache
def reason_unavailable() -> str:
    """Return why no namespaces can be made here; empty if they can."""
    if missing := [tool for tool in TOOLS if shutil.which(tool) is None]:
        return f"no network namespaces: {', '.join(missing)} not found (packages iproute2, util-linux)"
    try:
        with bridged_network("probe") as one:
            one.machine("a", "10.231.0.1", "probe")
    except (OSError, subprocess.CalledProcessError, RuntimeError) as error:
        said = error.stderr if isinstance(error, subprocess.CalledProcessError) else str(error)
        return f"no network namespaces, which need root or CAP_NET_ADMIN and CAP_SYS_ADMIN: {said.strip()}"
    return ""


class Process:
    """A process of one machine; its output goes into a file."""

    def __init__(self, words: Sequence[str], log: Path, cwd: Path) -> None:
        self.log = log
        with log.open("ab") as output:
            self._process = subprocess.Popen(
                [*words],
                cwd=cwd,
                stdin=subprocess.PIPE,
                stdout=output,
                stderr=output,
                text=True,
                env=os.environ | {"PYTHONUNBUFFERED": "1"},
            )

    @property
    def output(self) -> str:
        return self.log.read_text(errors="replace")

    def lines(self, since: int = 0) -> list[str]:
        """Return whole lines from character `since` on."""
        return self.output[since:].split("\n")[:-1]

    def mark(self) -> int:
        """Return a value of `since` for the output from now on."""
        return len(self.output)

    def wait_for(self, *texts: str, since: int = 0, within_s: float = LIMIT_S, but_not: str = "\0") -> None:
        """Wait for a line with all of these texts and without `but_not`."""

        def is_printed() -> bool:
            return any(
                all(text in line for text in texts) and but_not not in line for line in self.lines(since)
            )

        def over() -> bool:
            return is_printed() or self._process.poll() is not None

        what = f"{self.log.name}: {' … '.join(texts)}"
        until(over, lambda: f"{what}\nbut\n{self.output[since:]}", within_s)
        assert is_printed(), (
            f"the process ended with {self._process.poll()} before {what}\nbut\n{self.output}"
        )

    def enter(self) -> None:
        """Type an empty line."""
        assert self._process.stdin is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()

    def interrupt(self) -> None:
        self._process.send_signal(signal.SIGINT)

    def kill(self) -> None:
        """Kill the process without a warning."""
        self._process.kill()
        self._process.communicate()

    def ended(self, within_s: float = LIMIT_S) -> int:
        """Wait for the end of the process and return its exit code."""
        until(lambda: self._process.poll() is not None, lambda: f"the end of\n{self.output}", within_s)
        return int(self._process.returncode)


class BridgedNetwork:
    """Machines on bridges; a machine can be cut off, and so can a bridge from the others."""

    def __init__(self, bridges: Sequence[str]) -> None:
        self._held: dict[str, subprocess.Popen[str]] = {}
        self._processes: list[Process] = []
        self._bridges = bridges

    def open(self) -> None:
        """Make the bridges, each but the first with a cable to the first."""
        self._hold("ether")
        for bridge in self._bridges:
            self._ip("ether", "link", "add", "name", bridge, "up", "type", "bridge")
        for bridge in self._bridges[1:]:
            far = f"{bridge}-far"
            self._ip("ether", "link", "add", "name", f"{bridge}-to", "type", "veth", "peer", "name", far)
            self._ip("ether", "link", "set", far, "master", self._bridges[0], "up")
            self._ip("ether", "link", "set", f"{bridge}-to", "master", bridge, "up")

    def close(self) -> None:
        for process in self._processes:
            process.kill()
        for holder in self._held.values():
            holder.kill()
            holder.communicate()

    def machine(self, name: str, address: str, bridge: str) -> None:
        """Make a machine with a name of at most 12 characters and an address in a /24 network."""
        pid = str(self._hold(name))
        self._ip(
            "ether", "link", "add", "name", f"to-{name}", "type", "veth", "peer", "name", "eth0", "netns", pid
        )
        self._ip("ether", "link", "set", f"to-{name}", "master", bridge, "up")
        self._ip(name, "link", "set", "lo", "up")
        self._ip(name, "address", "add", f"{address}/24", "dev", "eth0")
        self._ip(name, "link", "set", "eth0", "up")

    def cut(self, name: str) -> None:
        """Cut the cable of a machine, or of a bridge to the first, without any notice."""
        self._ip("ether", "link", "set", self._cable(name), "down")

    def heal(self, name: str) -> None:
        self._ip("ether", "link", "set", self._cable(name), "up")

    def start(self, name: str, words: Sequence[str], log: Path) -> Process:
        """Start a process on a machine; it ends with the tests."""
        self._processes.append(Process([*self._inside(name), *words], log, log.parent))
        return self._processes[-1]

    def run(self, name: str, words: Sequence[str], cwd: Path) -> subprocess.CompletedProcess[str]:
        """Run a process that ends by itself."""
        command = [*self._inside(name), *words]
        return subprocess.run(command, cwd=cwd, timeout=LIMIT_S, capture_output=True, text=True, check=False)

    def udp_socket(self, name: str, port: int = 0) -> socket.socket:
        """Return a UDP socket of a machine, bound to its loopback, for use in this process."""
        # setns() changes the namespace of the calling thread only.
        with ThreadPoolExecutor(1) as thread:
            return thread.submit(self._bound_socket, self._held[name].pid, port).result()

    @staticmethod
    def _bound_socket(pid: int, port: int) -> socket.socket:
        with Path(f"/proc/{pid}/ns/net").open() as namespace:
            if ctypes.CDLL(None, use_errno=True).setns(namespace.fileno(), CLONE_NEWNET):
                raise OSError(ctypes.get_errno(), "setns")
        made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        made.bind(("127.0.0.1", port))
        return made

    def _cable(self, name: str) -> str:
        return f"{name}-to" if name in self._bridges else f"to-{name}"

    def _hold(self, name: str) -> int:
        """Return the process id of a new namespace."""
        holder = subprocess.Popen(
            ["unshare", "--net", "sh", "-c", HOLD],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self._held[name] = holder
        assert holder.stdout is not None
        if not holder.stdout.readline():
            raise RuntimeError(holder.communicate()[1])
        return holder.pid

    def _inside(self, name: str) -> list[str]:
        namespace = f"--net=/proc/{self._held[name].pid}/ns/net"
        return ["nsenter", namespace, "setpriv", "--pdeathsig", "KILL"]

    def _ip(self, name: str, *words: str) -> None:
        command = [*self._inside(name), "ip", *words]
        subprocess.run(command, check=True, capture_output=True, text=True, timeout=10.0)


@contextlib.contextmanager
def bridged_network(*bridges: str) -> Iterator[BridgedNetwork]:
    """Make a network for a while; it ends with all processes in it."""
    made = BridgedNetwork(bridges)
    try:
        made.open()
        yield made
    finally:
        made.close()
