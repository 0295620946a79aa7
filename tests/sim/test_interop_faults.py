"""Faults as others give them: MAVSDK's failure plug-in, the command line; and signing by mavutil."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from mavsdk import ComponentType, Configuration, ConnectionResult, Mavsdk
from mavsdk.plugins.failure import Failure, FailureError, FailureResult, FailureType, FailureUnit
from mavsdk.plugins.param import Param
from mavsdk.plugins.telemetry import Telemetry
from pymavlink import mavutil
from simulator_process import LIMIT_S, run, simulator, udp_socket

pytestmark = pytest.mark.interop


def free_udp_port() -> int:
    probe, port = udp_socket()
    probe.close()
    return port


@contextmanager
def system_of(personality: str) -> Iterator[Any]:
    port = free_udp_port()
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    assert mavsdk.add_any_connection(f"udpin://127.0.0.1:{port}") == ConnectionResult.SUCCESS
    try:
        with simulator("--personality", personality, "--speedup", "5", "--url", f"udpout:127.0.0.1:{port}"):
            system = mavsdk.first_autopilot(LIMIT_S)
            assert system is not None
            yield system
    finally:
        mavsdk.destroy()


def until(condition: Callable[[], bool], what: str) -> None:
    end_s = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < end_s, f"{what}: not within {LIMIT_S} s"
        time.sleep(0.02)


def inject(failure: Failure, unit: FailureUnit, kind: FailureType) -> FailureResult:
    try:
        return failure.inject(unit, kind, 0)
    except FailureError as error:
        return error.result


def test_mavsdk_injects_failures_into_px4_and_takes_them_back() -> None:
    with system_of("px4") as system:
        param, telemetry = Param(system), Telemetry(system)
        refused = inject(Failure(system), FailureUnit.SENSOR_GPS, FailureType.OFF)
        assert refused in (FailureResult.DENIED, FailureResult.DISABLED)
        param.set_param_int("SYS_FAILURE_EN", 1)
        failure = Failure(system)  # asks for the parameter once
        until(lambda: telemetry.gps_info().num_satellites > 5, "satellites before")
        assert inject(failure, FailureUnit.SENSOR_GPS, FailureType.OFF) is FailureResult.SUCCESS
        until(lambda: telemetry.gps_info().num_satellites == 0, "no satellites")
        assert inject(failure, FailureUnit.SENSOR_GPS, FailureType.OK) is FailureResult.SUCCESS
        until(lambda: telemetry.gps_info().num_satellites > 5, "satellites after")
        assert inject(failure, FailureUnit.SYSTEM_SERVO, FailureType.OFF) is FailureResult.UNSUPPORTED


def test_mavutil_signs_and_is_obeyed_and_without_the_key_is_not() -> None:
    port = free_udp_port()
    key = bytes(range(32))
    with simulator("--url", f"udpout:127.0.0.1:{port}"):
        link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", source_system=255)
        try:
            assert link.wait_heartbeat(timeout=LIMIT_S) is not None
            stamp = int((time.time() - 1_420_070_400) * 100_000)
            link.mav.setup_signing_send(link.target_system, link.target_component, list(key), stamp)
            link.recv_match(
                condition="HEARTBEAT.get_header().incompat_flags",
                type="HEARTBEAT",
                blocking=True,
                timeout=LIMIT_S,
            )
            link.set_mode("GUIDED")
            link.setup_signing(key, sign_outgoing=True)
            signed = link.recv_match(type="HEARTBEAT", blocking=True, timeout=LIMIT_S)
            assert signed is not None
            assert signed.get_signed()
            assert signed.custom_mode == 0  # the unsigned change of mode was not obeyed
            link.set_mode("GUIDED")
            changed = link.recv_match(
                condition="HEARTBEAT.custom_mode==4", type="HEARTBEAT", blocking=True, timeout=LIMIT_S
            )
            assert changed is not None
        finally:
            link.close()


def test_the_command_line_lists_faults_and_names_what_is_wrong_with_one() -> None:
    listed = run("--fault", "help")
    assert listed.returncode == 0
    assert "packet_loss: frames are lost at random" in listed.stdout
    wrong = run("--fault", "packet_loss:rate=2")
    assert wrong.returncode == 2
    assert "fault packet_loss: rate=2" in wrong.stderr
