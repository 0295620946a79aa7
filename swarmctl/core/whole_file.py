"""Writing of a file whole or not at all. This is the only module of the room with I/O."""

from __future__ import annotations

import os
from pathlib import Path


def write_whole(path: Path, content: bytes, mode: int | None = None) -> None:
    """Write a file in one step: after a crash or a power cut the old or the new file is there, never a half.

    `mode`: permissions of the file, less the umask. None: the old file's permissions, or 0666 less the umask
    for a new file. Raises OSError.
    """
    kept = path.stat().st_mode & 0o777 if mode is None and path.exists() else None
    first = mode if mode is not None else 0o666 if kept is None else kept
    draft = path.with_name(f".{path.name}.{os.getpid()}.new")
    draft.unlink(missing_ok=True)
    try:
        with os.fdopen(os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, first), "wb") as file:
            if kept is not None:
                os.fchmod(file.fileno(), kept)  # the umask may have removed permissions
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        draft.replace(path)
    except BaseException:
        draft.unlink(missing_ok=True)
        raise
