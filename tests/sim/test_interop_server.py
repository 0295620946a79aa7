"""`python -m sim_vehicle` as a process: what it says, how it ends, what it refuses."""

import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from simulator_process import LIMIT_S, Ground, free_tcp_port, line, run, simulator, udp_socket

pytestmark = pytest.mark.interop


def test_it_says_what_it_is_and_ends_cleanly_on_a_signal() -> None:
    udp, port = udp_socket()
    with udp, simulator("--count", "5", "--speedup", "10", "--url", f"udpout:127.0.0.1:{port}") as process:
        said = line(process)
    assert said == f"sim_vehicle: 5 ardupilot copters, sysid 1-5, udpout 127.0.0.1:{port}, 10x real time\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
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


def test_a_reader_of_its_lines_may_leave() -> None:
    udp, port = udp_socket()
    with udp, simulator("--speedup", "10", "--url", f"udpout:127.0.0.1:{port}") as process:
        assert line(process)
        process.stdout.close()
        process.stdout = None
        Ground(udp).systems(1)


def test_ground_stations_meet_a_mixed_fleet() -> None:
    udp, port = udp_socket()
    url = f"udpout:127.0.0.1:{port}"
    with udp, simulator("--personality", "ardupilot:1,px4:2", "--speedup", "5", "--url", url) as process:
        assert "1 ardupilot copter and 2 px4 copters, sysid 1-3" in line(process)
        ground = Ground(udp)
        ground.systems(1, 2, 3)
    autopilots = {m.get_srcSystem(): m.autopilot for m in ground.heard if m.get_type() == "HEARTBEAT"}
    assert autopilots == {1: 3, 2: 12, 3: 12}


def test_a_port_that_is_taken_is_an_error_with_code_2() -> None:
    udp, port = udp_socket()
    with udp:
        done = run("--url", f"udpin:127.0.0.1:{port}")
    assert done.returncode == 2
    assert re.fullmatch(
        rf"sim_vehicle: cannot open udpin 127.0.0.1:{port}: .*Choose .*--url\.\n", done.stderr
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--url", "udp:127.0.0.1:1"), "udp can mean two things; udpout:HOST:PORT sends there"),
        (("--url", "serial:x"), "expected serial:DEVICE:BAUD, for example serial:/dev/ttyUSB0:57600"),
        (("--url", "serial:/dev/not-there:57600"), "cannot open serial /dev/not-there:57600"),
        (("--url", "udpout:no.such.host.invalid:1"), "the host 'no.such.host.invalid' is not known"),
        (("--url", "tcpin:127.0.0.1:65535", "--count", "2", "--per-port", "1"), "65535 is the last"),
        (("--home", "here"), "is not LAT,LON,ALT[,HEADING], for example"),
        (("--scenario", "/nowhere.yaml"), "cannot be read"),
        (("--speedup", "0"), "'--speedup'"),
        (("--count", "0"), "'--count'"),
        (("--fault", "packet_los"), "packet_loss"),
        (("--fault", "packet_loss:rate=2"), "rate"),
        (("--param", "WPNAV_SPED=3"), "did you mean WPNAV_SPEED"),
        (("--step", "--speedup", "2"), "drop one of them"),
        (("--nonsense",), "--nonsense"),
        (("--personality", "apm"), "expected ardupilot, px4, mixed"),
        (("--sysid", "200", "--count", "100", "--per-port", "60"), "at most 51 fit on a port"),
    ],
)
def test_bad_arguments_are_one_line_each_and_code_2(arguments: tuple[str, ...], words: str) -> None:
    done = run(*arguments)
    assert done.returncode == 2
    assert words in done.stderr
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert done.stderr.startswith("sim_vehicle: ")


def test_all_that_is_wrong_is_said_at_once() -> None:
    done = run("--home", "x", "--wind", "y", "--fault", "z", "--param", "w", "--url", "v")
    assert done.returncode == 2
    starts = [text.split()[1] for text in done.stderr.splitlines()]
    assert sorted(starts) == ["--fault", "--home", "--param", "--url", "--wind"]


def test_fault_help_lists_them_all() -> None:
    done = run("--fault", "help")
    assert done.returncode == 0
    assert "packet_loss: " in done.stdout
    assert "link_outage: " in done.stdout


def test_it_ends_when_its_parent_is_gone() -> None:
    udp, port = udp_socket()
    udp.close()
    parent = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    arguments = ("--url", f"udpout:127.0.0.1:{port}", "--parent-pid", str(parent.pid))
    with simulator(*arguments) as process:
        assert line(process)
        parent.communicate(b"\n", timeout=LIMIT_S)
        assert process.wait(timeout=LIMIT_S) == 0


def test_a_machine_that_cannot_keep_up_says_so() -> None:
    url = f"tcpin:127.0.0.1:{free_tcp_port()}"
    more = ("--count", "200", "--speedup", "1000", "--url", url)
    with simulator(*more, errors=lambda _: True) as process:
        assert line(process)
        warning = process.stderr.readline()
        process.terminate()
        said = process.stdout.read()
    assert re.match(r"sim_vehicle: cannot keep up with 1000x real time: \d+\.\d s lost so far; .*\n", warning)
    assert re.search(r"\d+\.\d s lost because the machine was too slow", said)


def test_time_stands_still_until_it_is_stepped() -> None:
    udp, port = udp_socket()
    with udp, simulator("--count", "2", "--step", "--url", f"udpout:127.0.0.1:{port}") as process:
        assert line(process).endswith("stepped by hand\n")
        ground = Ground(udp)
        for at_s in (10, 20):
            process.stdin.write("step 10\n")
            process.stdin.flush()
            assert line(process) == f"at {at_s}\n"
            ground.systems(1, 2)
            ground.answered(at_s, 1)
            beats = [m.get_srcSystem() for m in ground.heard if m.get_type() == "HEARTBEAT"]
            assert abs(beats.count(1) - at_s) <= 1
            assert abs(beats.count(2) - at_s) <= 1
        process.stdin.write("quit\n")
        process.stdin.flush()
        assert process.wait(timeout=LIMIT_S) == 0


def test_stepping_reads_a_file_and_ends_with_it(tmp_path: Path) -> None:
    udp, port = udp_socket()
    script = tmp_path / "steps"
    script.write_text("step 1.5\nfly\nstep -1\n\nstep 0.25\n")
    command = [sys.executable, "-m", "sim_vehicle", "--step", "--url", f"udpout:127.0.0.1:{port}"]
    with udp, script.open() as steps:
        done = subprocess.run(
            command, stdin=steps, capture_output=True, text=True, timeout=LIMIT_S, check=False
        )
    assert done.returncode == 0
    assert done.stdout.splitlines()[1:3] == ["at 1.5", "at 1.75"]
    assert [text.split(" is ")[0] for text in done.stderr.splitlines()] == [
        "sim_vehicle: 'fly'",
        "sim_vehicle: 'step -1'",
    ]


def test_what_each_vehicle_sends_is_logged(tmp_path: Path) -> None:
    script = tmp_path / "steps"
    script.write_text("step 10\n")
    command = [sys.executable, "-m", "sim_vehicle", "--step", "--count", "2", "--url"]
    command.append(f"tcpin:127.0.0.1:{free_tcp_port()}")
    for name in ("first", "second"):
        with script.open() as steps:
            subprocess.run(
                [*command, "--tlog", str(tmp_path / name)],
                stdin=steps, capture_output=True, timeout=LIMIT_S, check=True,
            )  # fmt: skip
    logs = sorted(path.name for path in (tmp_path / "first").iterdir())
    assert len(logs) == 2
    for log in logs:
        data = (tmp_path / "first" / log).read_bytes()
        assert data.count(b"\xfd") >= 10
        assert data == (tmp_path / "second" / log).read_bytes()
