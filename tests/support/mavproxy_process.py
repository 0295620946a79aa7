"""MAVProxy as a process: commands to standard input, lines from output; every wait has a time-out."""

import os
import re
import select
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

LIMIT_S = 30.0
SHOWN = 2000


def program() -> str:
    """Return the path of MAVProxy: beside this Python, in MAVPROXY_BIN, or on PATH."""
    folders = [
        os.environ.get("MAVPROXY_BIN", ""),
        str(Path(sys.executable).parent),
        os.environ.get("PATH", ""),
    ]
    found = shutil.which("mavproxy.py", path=os.pathsep.join(filter(None, folders)))
    assert found is not None, (
        "mavproxy.py is not installed: `pip install 'mavlink-swarmctl[test]'` has it, "
        "or name its folder in MAVPROXY_BIN"
    )
    return found


class MAVProxy:
    """A running MAVProxy; `expect` continues after the previous match."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdin is not None
        assert process.stdout is not None
        self._in, self._out = process.stdin, process.stdout.fileno()
        self.text = ""
        self._position = 0

    def command(self, text: str) -> None:
        self._in.write(f"{text}\n".encode())
        self._in.flush()

    def look(self, pattern: str, limit_s: float) -> re.Match[str] | None:
        """Return the next match, or None after the time limit."""
        end_s = time.monotonic() + limit_s
        while True:
            match = re.compile(pattern, re.MULTILINE).search(self.text, self._position)
            if match is not None:
                self._position = match.end()
                return match
            left_s = end_s - time.monotonic()
            ready = left_s > 0 and select.select([self._out], [], [], left_s)[0]
            data = os.read(self._out, 65_536) if ready else b""
            if not data:
                return None
            self.text += data.decode("utf-8", "replace").replace("\r", "")

    def expect(self, pattern: str) -> re.Match[str]:
        """Return the next match; fail with the output otherwise."""
        match = self.look(pattern, LIMIT_S)
        assert match is not None, (
            f"{pattern!r} not within {LIMIT_S} s after\n{self.text[: self._position][-SHOWN:]}\n"
            f"-- in --\n{self.text[self._position :][-SHOWN:]}"
        )
        return match

    def ask(self, command: str, pattern: str) -> re.Match[str]:
        self.command(command)
        return self.expect(pattern)


@contextmanager
def mavproxy(master: str, folder: Path, *arguments: str) -> Iterator[MAVProxy]:
    """Run MAVProxy connected to `master`, with its files in `folder`."""
    command = [
        program(), f"--master={master}", f"--state-basedir={folder}", "--aircraft=test", *arguments,
    ]  # fmt: skip
    environment = os.environ | {"HOME": str(folder), "PYTHONUNBUFFERED": "1", "TERM": "dumb"}
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        cwd=folder, env=environment,
    )  # fmt: skip
    proxy = MAVProxy(process)
    try:
        yield proxy
    finally:
        try:
            process.communicate(timeout=LIMIT_S)  # ends with its input
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            raise
