"""The section `links` of a configuration: forwarding, signing, and message rates of all MAVLink links."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field

from swarmctl.core.section import Section
from swarmctl.links.url import parse_url


def _url(text: str) -> str:
    parse_url(text)
    return text


MavlinkUrl = Annotated[str, AfterValidator(_url)]


class Links(Section):
    """Settings that the MAVLink links of all vehicles share."""

    forward: tuple[MavlinkUrl, ...] = Field(
        (),
        description="MAVLink URLs that receive a copy of all traffic from and to the vehicles, unaltered: "
        "for QGroundControl or Mission Planner, such as udpout:127.0.0.1:14550. Default: none.",
    )
    signing_key: str | None = Field(
        None,
        description="File with the MAVLink signing key of the vehicles, relative to the folder of the "
        "command: 64 hexadecimal digits, base64 as in Mission Planner, or `passphrase: WORDS`. Messages "
        "not signed with this key are refused, except RADIO_STATUS. Default: no signing.",
    )
    signing_link_id: int = Field(
        0,
        ge=0,
        le=255,
        description="Link id of the first link in signatures; each further link has the next number. "
        "Stations that share a vehicle and a key need different ids.",
    )
    position_hz: float | None = Field(
        None,
        ge=2.0,
        le=10.0,
        description="Requested position rate of each vehicle [Hz]; a low rate slows other messages too. "
        "Default: 4 (ArduPilot) or 5 (PX4). Use 2 for a radio that several vehicles share.",
    )
    stop_other_streams: bool = Field(
        False,
        description="Stop the messages that this program does not read (attitude, …), until the vehicle "
        "boots again. Other programs on the link do not receive these messages either.",
    )
    forward_commands: bool = Field(
        False,
        description="Pass messages of the programs in `forward` on to the vehicles. The evidence attributes "
        "these messages to another station.",
    )
