"""Machines in miniature for tests: network namespaces on bridges, and processes in them.

A namespace lives as long as the process that holds it, which ends when its standard input is closed, and so
also when the tests are killed. Nothing of it is seen in the namespace the tests run in.
"""

from __future__ import annotations

import contextlib
import functools
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

HOLD = "echo held; exec cat"
TOOLS = ("ip", "nsenter", "setpriv", "unshare")
LOOKED_AT_EVERY_S = 0.05


def until(true: Callable[[], object], what: Callable[[], str], within_s: float) -> None:
    """Wait for something that other processes do."""
    end_s = time.monotonic() + within_s
    while not true():
        assert time.monotonic() < end_s, f"not within {within_s:g} s: {what()}"
        time.sleep(LOOKED_AT_EVERY_S)


@functools.cache
def why_not() -> str:
    """Why no namespaces can be made here; empty if they can."""
    if missing := [tool for tool in TOOLS if shutil.which(tool) is None]:
        return f"no network namespaces: {', '.join(missing)} not found (packages iproute2, util-linux)"
    try:
        with ether("probe") as one:
            one.machine("a", "10.231.0.1", "probe")
    except (OSError, subprocess.CalledProcessError, RuntimeError) as error:
        said = error.stderr if isinstance(error, subprocess.CalledProcessError) else str(error)
        return f"no network namespaces, which need root or CAP_NET_ADMIN and CAP_SYS_ADMIN: {said.strip()}"
    return ""


class Process:
    """Of one machine; what it says goes into a file, so that nobody has to keep reading."""

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
    def said(self) -> str:
        return self.log.read_text(errors="replace")

    def lines(self, since: int = 0) -> list[str]:
        """Whole ones, from character `since` on."""
        return self.said[since:].split("\n")[:-1]

    def mark(self) -> int:
        """For `since`: only what is said from now on."""
        return len(self.said)

    def says(self, *texts: str, since: int = 0, within_s: float = 20.0, but_not: str = "\0") -> None:
        """Wait for a line with all of these texts and without `but_not`."""

        def has_said() -> bool:
            return any(
                all(text in line for text in texts) and but_not not in line for line in self.lines(since)
            )

        def over() -> bool:
            return has_said() or self._process.poll() is not None

        what = f"{self.log.name}: {' … '.join(texts)}"
        until(over, lambda: f"{what}\nbut\n{self.said[since:]}", within_s)
        assert has_said(), f"it ended with {self._process.poll()} before {what}\nbut\n{self.said}"

    def enter(self) -> None:
        """An empty line, as from its keyboard."""
        assert self._process.stdin is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()

    def interrupt(self) -> None:
        self._process.send_signal(signal.SIGINT)

    def kill(self) -> None:
        """Without any warning."""
        self._process.kill()
        self._process.communicate()

    def ended(self, within_s: float) -> int:
        """Its exit code, once it ends by itself."""
        until(lambda: self._process.poll() is not None, lambda: f"the end of\n{self.said}", within_s)
        return int(self._process.returncode)


class Ether:
    """Machines on bridges; a machine can be cut off, and so can a bridge from the others."""

    def __init__(self, bridges: Sequence[str]) -> None:
        self._held: dict[str, subprocess.Popen[str]] = {}
        self._processes: list[Process] = []
        self._bridges = bridges

    def open(self) -> None:
        """The bridges, each but the first with a cable to the first."""
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
        """Of a name of at most 12 characters, with an address of a network of 256."""
        pid = str(self._hold(name))
        self._ip(
            "ether", "link", "add", "name", f"to-{name}", "type", "veth", "peer", "name", "eth0", "netns", pid
        )
        self._ip("ether", "link", "set", f"to-{name}", "master", bridge, "up")
        self._ip(name, "link", "set", "lo", "up")
        self._ip(name, "address", "add", f"{address}/24", "dev", "eth0")
        self._ip(name, "link", "set", "eth0", "up")

    def cut(self, name: str) -> None:
        """The cable of a machine, or of a bridge to the first; nobody is told."""
        self._ip("ether", "link", "set", self._cable(name), "down")

    def heal(self, name: str) -> None:
        self._ip("ether", "link", "set", self._cable(name), "up")

    def start(self, name: str, words: Sequence[str], log: Path) -> Process:
        """A process on a machine, which ends with the tests."""
        self._processes.append(Process([*self._inside(name), *words], log, log.parent))
        return self._processes[-1]

    def run(self, name: str, words: Sequence[str], cwd: Path) -> subprocess.CompletedProcess[str]:
        """A process that ends by itself."""
        command = [*self._inside(name), *words]
        return subprocess.run(command, cwd=cwd, timeout=60.0, capture_output=True, text=True, check=False)

    def _cable(self, name: str) -> str:
        return f"{name}-to" if name in self._bridges else f"to-{name}"

    def _hold(self, name: str) -> int:
        """The process of a new namespace."""
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
def ether(*bridges: str) -> Iterator[Ether]:
    """Gone afterwards, with all processes in it."""
    made = Ether(bridges)
    try:
        made.open()
        yield made
    finally:
        made.close()
