"""Signing by mavutil."""

import time

import pytest
from pymavlink import mavutil
from simulator_process import LIMIT_S, free_udp_port, simulator

pytestmark = pytest.mark.interop


@pytest.mark.full
def test_commands_of_mavutil_need_the_key_and_a_signature() -> None:
    port = free_udp_port()
    key = bytes(range(32))
    with simulator("--speedup", "5", "--url", f"udpout:127.0.0.1:{port}"):
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
            assert signed.custom_mode == 0  # the unsigned mode change was ignored
            link.set_mode("GUIDED")
            changed = link.recv_match(
                condition="HEARTBEAT.custom_mode==4", type="HEARTBEAT", blocking=True, timeout=LIMIT_S
            )
            assert changed is not None
        finally:
            link.close()
