"""`python -m sim_vehicle` as a process: output, ends, refused arguments."""

import contextlib
import fcntl
import json
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from importlib.metadata import version
from pathlib import Path

import pytest
from simulator_process import LIMIT_S, Ground, free_tcp_port, line, run, shell, simulator, udp_socket

pytestmark = pytest.mark.interop

HOP = """
home: {{lat_deg: 46.0490, lon_deg: 14.5060}}
count: 1
ready_s: 0
script: [takeoff: 5]
checks: [max_height_m: {}]
until_s: 12
"""


@pytest.mark.parametrize("number", [pytest.param(signal.SIGINT, marks=pytest.mark.full), signal.SIGTERM])
def test_two_lines_and_no_table_on_a_pipe(number: signal.Signals) -> None:
    udp, port = udp_socket()
    with udp, simulator("--count", "2", "--speedup", "10", "--url", f"udpout:127.0.0.1:{port}") as process:
        Ground(udp).systems(1, 2)
        process.send_signal(number)
        first, last = process.stdout.read().splitlines()
    assert first.startswith("sim_vehicle: 2 ardupilot copters")
    assert re.fullmatch(
        r"sim_vehicle: \d+\.\d s simulated, \d+ messages sent \(\d+ datagrams dropped\), \d+ received, "
        r"heartbeats late by \d+\.\d ms \(p50\), \d+\.\d ms \(p99\)",
        last,
    )


def test_a_used_port_is_an_error_with_code_2() -> None:
    udp, port = udp_socket()
    with udp:
        done = run("--url", f"udpin:127.0.0.1:{port}")
    assert done.returncode == 2
    assert re.fullmatch(rf"sim_vehicle: cannot open udpin 127.0.0.1:{port}: .*\[port-in-use\]\n", done.stderr)


@pytest.mark.full
@pytest.mark.parametrize(
    ("arguments", "found"),
    [
        (("--url", "serial:/dev/not-there:57600"), "cannot open serial /dev/not-there:57600"),
        (("--url", "udpout:no.such.host.invalid:1"), "[unknown-host]"),
        (("--url", "tcpin:127.0.0.1:65535", "--count", "2", "--per-port", "1"), "65535"),
        (("--scenario", "/nowhere.yaml"), "/nowhere.yaml: "),
        (("--speedup", "0"), "'--speedup'"),
        (("--step", "--speedup", "2"), "--speedup"),
        (("--nonsense",), "--nonsense"),
        (("run", "clean_misson"), "clean_mission?"),
    ],
)
def test_a_bad_argument_causes_one_line_and_exit_code_2(arguments: tuple[str, ...], found: str) -> None:
    done = run(*arguments)
    assert done.returncode == 2
    assert found in done.stderr
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert done.stderr.startswith("sim_vehicle: ")


def test_all_bad_arguments_are_reported_at_once() -> None:
    done = run("--home", "x", "--wind", "y", "--fault", "z", "--param", "w", "--url", "v")
    assert done.returncode == 2
    starts = [text.split()[1] for text in done.stderr.splitlines()]
    assert sorted(starts) == ["--fault", "--home", "--param", "--wind", "URL"]


def test_the_fleet_ends_with_its_parent_process() -> None:
    udp, port = udp_socket()
    udp.close()
    parent = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    arguments = ("--url", f"udpout:127.0.0.1:{port}", "--parent-pid", str(parent.pid))
    with simulator(*arguments) as process:
        assert line(process)
        parent.communicate(b"\n", timeout=LIMIT_S)
        assert process.wait(timeout=LIMIT_S) == 0


def test_manual_time_stands_still_between_steps() -> None:
    udp, port = udp_socket()
    with udp, simulator("--count", "2", "--step", "--url", f"udpout:127.0.0.1:{port}") as process:
        assert line(process).endswith("manual clock\n")
        ground = Ground(udp)
        for at_s in (10, 20):
            process.stdin.write("step 10\n")
            process.stdin.flush()
            assert line(process) == f"at {at_s}\n"
            ground.systems(1, 2)
            ground.answered(at_s, 1)
            beats = [m.get_srcSystem() for m in ground.received if m.get_type() == "HEARTBEAT"]
            assert abs(beats.count(1) - at_s) <= 1
            assert abs(beats.count(2) - at_s) <= 1
        process.stdin.write("quit\n")
        process.stdin.flush()
        assert process.wait(timeout=LIMIT_S) == 0


@pytest.mark.full
def test_stepping_needs_standard_input() -> None:
    done = run("--step", "--url", f"tcpin:127.0.0.1:{free_tcp_port()}", before="exec <&-")
    assert done.returncode == 2
    assert done.stderr.startswith("sim_vehicle: --step: ")


@pytest.mark.full
@pytest.mark.parametrize("lost", ["exec >&-", "exec >/dev/full", "exec 2>&-"])
def test_lost_output_does_not_end_the_fleet(lost: str) -> None:
    done = run("--step", "--url", f"tcpin:127.0.0.1:{free_tcp_port()}", before=lost, steps="fly\nstep 1\n")
    assert done.returncode == 0
    assert "Traceback" not in done.stderr


@pytest.mark.full
@pytest.mark.parametrize(
    ("reader", "message"),
    [("/dev/full", "sim_vehicle: standard output is lost (No space left on device)\n"), (None, "")],
)
@pytest.mark.parametrize(("height_m", "code"), [(1, 1), (50, 0)])
def test_a_run_with_lost_output_exits_with_its_verdict(
    tmp_path: Path, reader: str | None, message: str, height_m: int, code: int
) -> None:
    scenario = tmp_path / "hop.yaml"
    scenario.write_text(HOP.format(height_m))
    end, output = os.pipe()
    os.close(end)  # the reader has left
    if reader is not None:
        os.close(output)
        output = os.open(reader, os.O_WRONLY)
    command = [sys.executable, "-m", "sim_vehicle", "run", str(scenario), "--out", str(tmp_path)]
    done = subprocess.run(
        command, stdout=output, stderr=subprocess.PIPE, text=True, timeout=LIMIT_S, check=False
    )
    os.close(output)
    assert (done.returncode, done.stderr) == (code, message)
    assert json.loads((tmp_path / "hop" / "verdict.json").read_text())["passed"] is (code == 0)


@pytest.mark.full
@pytest.mark.parametrize("arguments", [(), ("run",), ("conformance",)])
def test_the_help_option_has_a_short_form(arguments: tuple[str, ...]) -> None:
    short, long = run(*arguments, "-h"), run(*arguments, "--help")
    assert short.returncode == long.returncode == 0
    assert short.stdout == long.stdout
    assert short.stdout.startswith("Usage: python -m sim_vehicle")


@pytest.mark.full
def test_the_version_is_printed() -> None:
    assert run("--version").stdout == f"sim_vehicle {version('mavlink-swarmctl')}\n"


class Terminal:
    """A terminal: `type` enters text, `until` waits for output."""

    def __init__(self, *arguments: str, width: int = 100, height: int = 12) -> None:
        self._end, terminal = pty.openpty()
        self.shown = ""
        self.resize(width, height)
        size = {"COLUMNS", "LINES"}  # they would override the terminal's size
        environment = {name: value for name, value in os.environ.items() if name not in size}
        environment["TERM"] = "xterm-256color"
        self.process = subprocess.Popen(
            shell("", *arguments, "--ready-s", "1", "--parent-pid", str(os.getpid())),
            stdin=terminal, stdout=terminal, stderr=terminal,
            env=environment, start_new_session=True,
        )  # fmt: skip
        os.close(terminal)

    def resize(self, width: int, height: int) -> None:
        fcntl.ioctl(self._end, termios.TIOCSWINSZ, struct.pack("HHHH", height, width, 0, 0))

    def type(self, text: str) -> None:
        os.write(self._end, text.encode())

    def until(self, text: str) -> str:
        """Return the output up to `text`."""
        end_s = time.monotonic() + LIMIT_S
        while text not in self.shown:
            assert select.select([self._end], [], [], max(end_s - time.monotonic(), 0.0))[0], self.shown
            self.shown += os.read(self._end, 65_536).decode()
        seen, _, self.shown = self.shown.partition(text)
        return seen + text

    def rest(self) -> str:
        """Return the output until the process ends with exit code 0."""
        with contextlib.suppress(OSError):  # EIO: the other end is closed
            while data := os.read(self._end, 65_536):
                self.shown += data.decode()
        assert self.process.wait(timeout=LIMIT_S) == 0
        return self.shown

    def __enter__(self) -> "Terminal":
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()
        os.close(self._end)


OWN_SCREEN, BACK = "\x1b[?1049h", "\x1b[?1049l"


@pytest.mark.full
def test_the_manual_clock_on_a_terminal_shows_input_and_answers() -> None:
    with Terminal("--step", "--url", f"tcpin:127.0.0.1:{free_tcp_port()}") as terminal:
        seen = terminal.until("step 0.5\r\n")
        terminal.type("step 2\n")
        seen += terminal.until("\r\nat 2\r\n")
        terminal.type("fly\n")
        seen += terminal.until("'fly'")
        terminal.type("quit\n")
        seen += terminal.rest()
    assert OWN_SCREEN not in seen
    assert "2.0 s simulated" in seen


def test_the_table_uses_the_alternate_screen_and_leaves_its_last_state() -> None:
    url = f"tcpin:127.0.0.1:{free_tcp_port()}"
    with Terminal("--count", "3", "--fault", "gps_loss", "--url", url, width=120) as terminal:
        before = terminal.until(OWN_SCREEN)
        terminal.until("latitude, longitude")
        terminal.resize(40, 12)
        terminal.until("\x1b[2J")  # cleared
        terminal.until("batt")
        terminal.process.send_signal(signal.SIGINT)
        terminal.until(BACK)
        after = [text.rstrip() for text in re.sub(r"\x1b\[[0-9;?]*[a-z]", "", terminal.rest()).splitlines()]
    assert "3 ardupilot copters" in before
    assert [text.split()[0] for text in after if "  STABILIZE  " in text] == ["1", "2", "3"]
    assert all(len(text) <= 40 for text in after[:-1])
    assert " s simulated, " in after[-1]


@pytest.mark.full
def test_a_full_disk_ends_the_logs_but_not_the_fleet(tmp_path: Path) -> None:
    more = ("--personality", "px4", "--count", "2", "--url", f"tcpin:127.0.0.1:{free_tcp_port()}")
    done = run("--step", *more, "--tlog", str(tmp_path), before="ulimit -f 20", steps="step 30\nstep 30\n")
    assert done.returncode == 0
    assert done.stdout.splitlines()[1:3] == ["at 30", "at 60"]
    assert done.stderr.count("\n") == 1
    assert f"--tlog {tmp_path}: " in done.stderr
    assert "[tlog-full]" in done.stderr


@pytest.mark.full
def test_serving_on_windows_is_refused() -> None:
    start = (
        "import sys; sys.modules['resource'] = None\n"
        "import sim_vehicle.__main__, sim_vehicle.serving.serve\n"
        "sys.platform, sys.argv = 'win32', ['sim_vehicle']\n"
        "sim_vehicle.__main__.main()"
    )
    done = subprocess.run(
        [sys.executable, "-c", start], capture_output=True, text=True, timeout=LIMIT_S, check=False
    )
    assert done.returncode == 2
    assert re.fullmatch(r"sim_vehicle: .*Windows.*\n", done.stderr)
