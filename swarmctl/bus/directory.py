"""Directory of the swarms that this user flies on this machine now, by the swarm's name.

Each flight has a locked file in the user's folder. A file without a lock is a stale record of a killed
flight: readers ignore the file, and the next flight removes it. After a flight an empty file keeps the time
of the flight's end.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import stat
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from swarmctl.bus.endpoint import BusEndpoint, parse_endpoint
from swarmctl.bus.transports.base import BusError


@dataclass(frozen=True, slots=True)
class RunningSwarm:
    swarm: str
    endpoint: BusEndpoint
    pid: int
    started_unix_s: float


@contextlib.contextmanager
def registered(swarm: str, endpoint: BusEndpoint) -> Iterator[None]:
    """List a flight in the directory while the context lasts, then record its end. Raises BusError."""
    entry = {"swarm": swarm, "endpoint": str(endpoint), "pid": os.getpid()}
    with contextlib.ExitStack() as stack:
        try:
            folder = _folder()
            _remove_stale(folder)
            path = folder / f"{swarm}.{os.getpid()}.json"
            draft = path.with_name(f".{path.name}")
            file = stack.enter_context(_locked(draft))
            stack.callback(draft.unlink, missing_ok=True)
            json.dump(entry, file)
            file.flush()
            draft.rename(path)
            stack.callback(record_end, swarm)
            stack.callback(path.unlink, missing_ok=True)
            _end_file(folder, swarm, None).unlink(missing_ok=True)
        except OSError as error:
            raise _unusable(error) from error
        yield


def running_swarms() -> list[RunningSwarm]:
    """Return the swarms that fly now, by name. Raises BusError."""
    try:
        found = [(path, _read(path)) for path in sorted(_folder().glob("*.json"))]
    except OSError as error:
        raise _unusable(error) from error
    return [entry for path, entry in found if entry is not None and not path.name.startswith(".")]


def record_end(swarm: str, uav: int | None = None) -> None:
    """Record that the flight of a swarm, or of one agent, ends now; ignore an unwritable folder."""
    with contextlib.suppress(OSError):
        _end_file(_folder(), swarm, uav).touch()


def forget_end(swarm: str, uav: int) -> None:
    """Remove the record of the end of an agent's earlier flight."""
    with contextlib.suppress(OSError):
        _end_file(_folder(), swarm, uav).unlink(missing_ok=True)


def ended_unix_s(swarm: str, uav: int | None = None) -> float | None:
    """Return the unix time [s] of the end of the last flight of a swarm, or of one agent; None if unknown."""
    with contextlib.suppress(OSError):
        return _end_file(_folder(), swarm, uav).stat().st_mtime
    return None


def _end_file(folder: Path, swarm: str, uav: int | None) -> Path:
    return folder / f"{swarm}@{'' if uav is None else uav}.ended"


def _locked(draft: Path) -> TextIO:
    """Open and lock a new file under its draft name; without a lock the file would count as stale.

    Raises OSError.
    """
    while True:
        with contextlib.ExitStack() as opened:
            file = opened.enter_context(draft.open("w", encoding="utf-8"))
            fcntl.flock(file, fcntl.LOCK_EX)
            if os.fstat(file.fileno()).st_nlink:
                opened.pop_all()
                return file
            # Another flight removed the file as stale before the lock.


def _unusable(error: OSError) -> BusError:
    return BusError(f"{error.filename or 'the folder of running swarms'}: {error.strerror or error}")


def _read(path: Path) -> RunningSwarm | None:
    """Return the record in a file; None for a stale, foreign or removed file."""
    try:
        with path.open(encoding="utf-8") as file:
            if _is_stale(file):
                return None
            content, started_s = json.load(file), os.fstat(file.fileno()).st_mtime
            endpoint = parse_endpoint(content["endpoint"])
            return RunningSwarm(content["swarm"], endpoint, content["pid"], started_s)
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

    Raises OSError if another user owns or can write to the folder: a forged record would redirect commands.
    """
    # Not below XDG_RUNTIME_DIR, which differs between a shell and a flight under cron or sudo.
    folder = Path(tempfile.gettempdir()) / f"swarmctl-{os.getuid()}"
    with contextlib.suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o022:
        raise OSError(0, "expected a folder that no other user can write to [open-folder]", str(folder))
    return folder
