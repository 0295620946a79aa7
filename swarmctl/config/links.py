"""Who else sees the vehicles' traffic, and who may speak to them: the section `links` of a configuration."""

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
    """What is common to the links of all vehicles."""

    forward: tuple[MavlinkUrl, ...] = Field(
        (),
        description="MAVLink URLs to which everything heard from vehicles and sent to them goes unaltered, "
        "for QGroundControl or Mission Planner to watch, such as udpout:127.0.0.1:14550",
    )
    signing_key: str | None = Field(
        None,
        description="file with the vehicles' key of MAVLink signing, as seen from where the commands run: 64 "
        "hexadecimal digits, base64 as in Mission Planner, or `passphrase: WORDS`; what is not signed with "
        "it is refused. Default: nothing is signed",
    )
    signing_link_id: int = Field(
        0,
        ge=0,
        le=255,
        description="of the first link in signatures, the next has the next; stations that speak to one "
        "vehicle with one key at once need different ones",
    )
    position_hz: float | None = Field(
        None,
        ge=2.0,
        le=10.0,
        description="positions a second that each vehicle is asked for, and the rest of what it tells in "
        "proportion. Default: 4 (ArduPilot) or 5 (PX4); 2 for radios that several vehicles share",
    )
    stop_other_streams: bool = Field(
        False,
        description="whether a vehicle is told, until it boots anew, to end what it streams over its link "
        "for people's instruments and nobody here looks at (attitude …); who watches misses it",
    )
    forward_commands: bool = Field(
        False,
        description="whether what such a program sends reaches the vehicles; it is in the evidence as "
        "another station's",
    )
