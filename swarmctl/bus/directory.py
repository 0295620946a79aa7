"""Directory of the swarms that this user flies on this machine now, by the swarm's name.

Each flight, and each agent without keys, has a locked file in the user's folder. No other user can read
the file, because it has the token that authenticates requests. A file without a lock is a stale record of
a killed process: readers ignore the file, and the next flight removes it.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import stat
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TextIO

from swarmctl.bus.endpoint import BusEndpoint, parse_endpoint
from swarmctl.bus.transports.base import BusError

FILE_MODE = 0o600


@dataclass(frozen=True, slots=True)
class RunningSwarm:
    swarm: str
    endpoint: BusEndpoint
    pid: int
    started_unix_s: float
    token: str = field(default="", repr=False, compare=False)
    """secret that authenticates requests"""


@dataclass(frozen=True, slots=True)
class RunningAgent:
    """An agent of one vehicle; other processes fly the other vehicles."""

    swarm: str
    uav: int
    token: str = field(repr=False)
    started_unix_s: float


def registered(swarm: str, endpoint: BusEndpoint, token: str) -> contextlib.AbstractContextManager[None]:
    """List a flight in the directory while the context lasts. Raises BusError."""
    return _listed(swarm, {"swarm": swarm, "endpoint": str(endpoint), "token": token})


def registered_agent(swarm: str, uav: int, token: str) -> contextlib.AbstractContextManager[None]:
    """Keep the token of the agent of vehicle `uav` in the directory while the context lasts.

    Raises BusError.
    """
    return _listed(f"{swarm}@{uav}", {"swarm": swarm, "uav": uav, "token": token})


@contextlib.contextmanager
def _listed(name: str, entry: dict[str, str | int]) -> Iterator[None]:
    """Keep a locked file with the entry in the directory while the context lasts. Raises BusError."""
    with contextlib.ExitStack() as stack:
        try:
            folder = _folder()
            _remove_stale(folder)
            path = folder / f"{name}.{os.getpid()}.json"
            draft = path.with_name(f".{path.name}")
            file = stack.enter_context(_locked(draft))
            stack.callback(draft.unlink, missing_ok=True)
            json.dump(entry | {"pid": os.getpid()}, file)
            file.flush()
            draft.rename(path)
            stack.callback(path.unlink, missing_ok=True)
        except OSError as error:
            raise _unusable(error) from error
        yield


def running_swarms() -> list[RunningSwarm]:
    """Return the swarms that fly now, by name. Raises BusError."""
    return [entry for entry in _entries() if isinstance(entry, RunningSwarm)]


def agent_tokens(swarm: str) -> dict[int, str]:
    """Return the tokens of a swarm's agents on this machine, by system id. Raises BusError."""
    agents = [entry for entry in _entries() if isinstance(entry, RunningAgent) and entry.swarm == swarm]
    # Of two agents of one vehicle the later one counts.
    return {agent.uav: agent.token for agent in sorted(agents, key=lambda agent: agent.started_unix_s)}


def _entries() -> list[RunningSwarm | RunningAgent]:
    """Return the running processes, by the names of their files. Raises BusError."""
    try:
        found = [_read(path) for path in sorted(_folder().glob("*.json")) if not path.name.startswith(".")]
    except OSError as error:
        raise _unusable(error) from error
    return [entry for entry in found if entry is not None]


def _locked(draft: Path) -> TextIO:
    """Open and lock a new file under its draft name; without a lock the file would count as stale.

    Raises OSError.
    """
    while True:
        with contextlib.ExitStack() as opened:
            flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW
            file = opened.enter_context(os.fdopen(os.open(draft, flags, FILE_MODE), "w", encoding="utf-8"))
            os.fchmod(file.fileno(), FILE_MODE)  # a killed process may have left the file with another mode
            fcntl.flock(file, fcntl.LOCK_EX)
            if os.fstat(file.fileno()).st_nlink:
                opened.pop_all()
                return file
            # Another flight removed the file as stale before the lock.


def _unusable(error: OSError) -> BusError:
    return BusError(f"{error.filename or 'the folder of running swarms'}: {error.strerror or error}")


def _read(path: Path) -> RunningSwarm | RunningAgent | None:
    """Return the record in a file; None for a stale, foreign or removed file."""
    try:
        with path.open(encoding="utf-8") as file:
            if _is_stale(file):
                return None
            content, started_s = json.load(file), os.fstat(file.fileno()).st_mtime
            if "uav" in content:
                return RunningAgent(content["swarm"], content["uav"], content["token"], started_s)
            endpoint = parse_endpoint(content["endpoint"])
            return RunningSwarm(content["swarm"], endpoint, content["pid"], started_s, content["token"])
    except (FileNotFoundError, ValueError, KeyError, TypeError):
        return None


def _remove_stale(folder: Path) -> None:
    for path in folder.glob("*.json"):
        with contextlib.suppress(FileNotFoundError), path.open(encoding="utf-8") as file:
            if _is_stale(file):
                path.unlink()


def _is_stale(file: TextIO) -> bool:
    """Return whether no flight holds the lock."""
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _folder() -> Path:
    """Return the directory's folder; create a missing folder.

    Raises OSError if another user owns the folder or has access: a forged record would redirect commands, and
    a token that others can read would authenticate them.
    """
    # Not below XDG_RUNTIME_DIR, which differs between a shell and a flight under cron or sudo.
    folder = Path(tempfile.gettempdir()) / f"swarmctl-{os.getuid()}"
    with contextlib.suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o077:
        raise OSError(
            0, "expected a folder of this user, without access for others [open-folder]", str(folder)
        )
    return folder
