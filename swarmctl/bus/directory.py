"""Which swarms of this machine and user fly now, and where each listens: how one is found by its name.

A file a flight, in a folder that is the user's own. The flight holds a lock on it, so that what a killed one
left behind is known for that and removed.
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
    """A swarm that flies now."""

    swarm: str
    endpoint: BusEndpoint
    pid: int


@contextlib.contextmanager
def registered(swarm: str, endpoint: BusEndpoint) -> Iterator[None]:
    """Be found as long as this lasts. Raises BusError."""
    entry = {"swarm": swarm, "endpoint": str(endpoint), "pid": os.getpid()}
    with contextlib.ExitStack() as held:
        try:
            path = _folder() / f"{swarm}.{os.getpid()}.json"
            draft = path.with_name(f".{path.name}")
            file = held.enter_context(_locked(draft))
            held.callback(draft.unlink, missing_ok=True)
            json.dump(entry, file)
            file.flush()
            draft.rename(path)
            held.callback(path.unlink, missing_ok=True)
        except OSError as error:
            raise _unusable(error) from error
        yield


def running_swarms() -> list[RunningSwarm]:
    """Every swarm that can be found, by name. Raises BusError."""
    try:
        found = [(path, _read(path)) for path in sorted(_folder().glob("*.json"))]
    except OSError as error:
        raise _unusable(error) from error
    return [entry for path, entry in found if entry is not None and not path.name.startswith(".")]


def _locked(draft: Path) -> TextIO:
    """A new file, locked before it gets its name: unlocked, it is taken for what a killed flight left.

    Raises OSError.
    """
    while True:
        with contextlib.ExitStack() as opened:
            file = opened.enter_context(draft.open("w", encoding="utf-8"))
            fcntl.flock(file, fcntl.LOCK_EX)
            if os.fstat(file.fileno()).st_nlink:
                opened.pop_all()
                return file
            # Taken for left behind, and removed, before the lock was had: once more.


def _unusable(error: OSError) -> BusError:
    return BusError(f"{error.filename or 'the folder of swarms'}: {error.strerror or error}")


def _read(path: Path) -> RunningSwarm | None:
    try:
        with path.open(encoding="utf-8") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except BlockingIOError:
                content = json.load(file)
                return RunningSwarm(content["swarm"], parse_endpoint(content["endpoint"]), content["pid"])
            path.unlink()
    except (FileNotFoundError, ValueError, KeyError, TypeError):
        pass  # it ended meanwhile, or is none of ours
    return None


def _folder() -> Path:
    """Made if it is not there. Raises OSError where it is somebody else's: a lie there would be believed."""
    # Not below XDG_RUNTIME_DIR: a flight under cron or sudo, and the shell beside it, have different ones.
    folder = Path(tempfile.gettempdir()) / f"swarmctl-{os.getuid()}"
    with contextlib.suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o022:
        raise OSError(0, "must be a folder of this user's that nobody else can write to", str(folder))
    return folder
