"""Standard output and standard error that tolerate a closed reader or a full disk."""

import io
import sys
from collections.abc import Callable
from typing import Any


class _MayGetLost(io.FileIO):
    """A file that treats failed writes as done, and reports the first."""

    def __init__(self, file: int, lost: Callable[[OSError], None]) -> None:
        super().__init__(file, "w", closefd=False)
        self._lost: Callable[[OSError], None] | None = lost

    def write(self, data: Any, /) -> int:
        try:
            return super().write(data)
        except OSError as error:
            lost, self._lost = self._lost, None
            if lost is not None:
                lost(error)
            return memoryview(data).nbytes


def let_output_get_lost() -> None:
    """Tolerate a closed pipe (`| head`) and a full disk; neither ends a run nor changes its exit code.

    A closed pipe causes no message; a full disk is reported on standard error.
    """
    if sys.platform == "win32":  # a console there is no file
        return
    sys.stdout = _as_it_was(sys.stdout, _told)
    sys.stderr = _as_it_was(sys.stderr, lambda _: None)


def _told(error: OSError) -> None:
    if sys.stderr is not None and not isinstance(error, BrokenPipeError):
        sys.stderr.write(f"sim_vehicle: standard output is lost ({error.strerror})\n")


def _as_it_was(stream: Any, lost: Callable[[OSError], None]) -> Any:
    if stream not in (sys.__stdout__, sys.__stderr__) or not isinstance(stream, io.TextIOWrapper):
        return stream  # closed or replaced
    return io.TextIOWrapper(
        io.BufferedWriter(_MayGetLost(stream.fileno(), lost)),
        encoding=stream.encoding,
        errors=stream.errors,
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )
