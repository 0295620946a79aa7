"""URL forms of MAVSDK and pymavlink."""

from __future__ import annotations

import pytest

from swarmctl.links.url import BadUrl, Endpoint, parse_url


@pytest.mark.parametrize(
    ("url", "endpoint"),
    [
        ("udpin://0.0.0.0:14550", Endpoint("udpin", "0.0.0.0", 14550)),
        ("udpin:127.0.0.1:14551", Endpoint("udpin", "127.0.0.1", 14551)),
        ("udpin://:14550", Endpoint("udpin", "0.0.0.0", 14550)),
        ("udp://:14550", Endpoint("udpin", "0.0.0.0", 14550)),
        ("udp:127.0.0.1:14550", Endpoint("udpin", "127.0.0.1", 14550)),
        ("udpout://drone.local:14550", Endpoint("udpout", "drone.local", 14550)),
        ("udpout:10.0.0.2:1", Endpoint("udpout", "10.0.0.2", 1)),
        ("tcp:127.0.0.1:5760", Endpoint("tcpout", "127.0.0.1", 5760)),
        ("tcp://127.0.0.1:5760", Endpoint("tcpout", "127.0.0.1", 5760)),
        ("tcpin://0.0.0.0:5760", Endpoint("tcpin", "0.0.0.0", 5760)),
        ("tcpout://sitl:5760", Endpoint("tcpout", "sitl", 5760)),
        ("udpin://[::1]:14550", Endpoint("udpin", "::1", 14550)),
        ("serial:///dev/ttyUSB0:57600", Endpoint("serial", "/dev/ttyUSB0", baud=57600)),
        ("serial:/dev/ttyACM0:115200", Endpoint("serial", "/dev/ttyACM0", baud=115200)),
        ("serial:///dev/ttyUSB0", Endpoint("serial", "/dev/ttyUSB0", baud=57600)),
        ("/dev/ttyUSB0,921600", Endpoint("serial", "/dev/ttyUSB0", baud=921600)),
        ("/dev/ttyUSB0", Endpoint("serial", "/dev/ttyUSB0", baud=57600)),
        ("memory:swarm", Endpoint("memory", "swarm")),
        ("  UDPIN://0.0.0.0:14550 ", Endpoint("udpin", "0.0.0.0", 14550)),
    ],
)
def test_each_form_is_read_and_written_back(url, endpoint):
    assert parse_url(url) == endpoint
    assert parse_url(str(endpoint)) == endpoint


@pytest.mark.parametrize(
    ("url", "found"),
    [
        ("", "found ''"),
        ("14550", "found '14550'"),
        ("http://x:1", "found 'http'"),
        ("udpin://0.0.0.0", "found '0.0.0.0'"),
        ("udpout://h:0", "found '0'"),
        ("udpin://0.0.0.0:65536", "found '65536'"),
        ("udpin://0.0.0.0:abc", "found 'abc'"),
        ("udpin://0.0.0.0:14550/x", "found '14550/x'"),
        ("udpout://:14550", "found ':14550'"),
        ("tcp::5760", "found ':5760'"),
        ("udpin://::1:14550", "found '::1'"),
        ("udpin://a b:1", "found 'a b'"),
        ("serial://ttyUSB0:57600", "found 'ttyUSB0'"),
        ("serial:///dev/ttyUSB0:fast", "found 'fast'"),
        ("/dev/ttyUSB0,-1", "found '-1'"),
        ("memory:", "found ''"),
    ],
)
def test_an_error_has_the_wrong_part_and_lists_the_forms(url, found):
    with pytest.raises(BadUrl) as caught:
        parse_url(url)
    assert found in str(caught.value)
    assert repr(url) in str(caught.value)
    assert "udpin://0.0.0.0:14550" in str(caught.value)
