"""Who hears whom, over what, and who belongs: the section `communication` of a configuration."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field

from swarmctl.bus.endpoint import NO_ENDPOINT, parse_endpoint
from swarmctl.core.section import Section

MAX_DELAY_S = 60.0


def _listen(text: str) -> str:
    if text != NO_ENDPOINT:
        parse_endpoint(text)
    return text


def _endpoint(text: str) -> str:
    endpoint = parse_endpoint(text)
    if endpoint.port == 0:
        raise ValueError(f"{text!r}: others have to find it; give it a port")
    if endpoint.reachable != endpoint:
        raise ValueError(f"{text!r}: others have to find it; give the address or name of the machine")
    return text


def _worded(value: Any) -> Any:
    """System ids as words, beside names: YAML reads `3: tcp/...` as a number."""
    if not isinstance(value, dict):
        return value
    return {str(key) if type(key) is int else key: endpoint for key, endpoint in value.items()}


def _in_order(from_s: float, until_s: float | None) -> None:
    if until_s is not None and until_s <= from_s:
        raise ValueError(f"until_s {until_s:g} is not after from_s {from_s:g}; a time ends after it begins")


Endpoint = Annotated[str, AfterValidator(_endpoint)]
Uav = int | str
"""a system id, or a vehicle's name"""


class PartitionSection(Section):
    """For a time, UAVs hear those of their own group only; who is in no group hears nobody. Of several at
    once, all have to let a message pass."""

    from_s: float = Field(
        ge=0.0, description="what is sent from here on, in simulated seconds since the start [s]"
    )
    until_s: float | None = Field(None, gt=0.0, description="and before this; default: to the end [s]")
    groups: tuple[tuple[Uav, ...], ...] = Field(
        min_length=1, description="names or system ids of those who still hear each other"
    )

    def model_post_init(self, _context: object) -> None:
        _in_order(self.from_s, self.until_s)
        if not all(self.groups):
            raise ValueError("a group is empty; leave it away, or say who is in it")


class QuietSection(Section):
    """For a time, UAVs send nothing; they hear."""

    uavs: tuple[Uav, ...] = Field(min_length=1, description="their names or system ids")
    from_s: float = Field(0.0, ge=0.0, description="from here on, in simulated seconds since the start [s]")
    until_s: float | None = Field(None, gt=0.0, description="and before this; default: to the end [s]")

    def model_post_init(self, _context: object) -> None:
        _in_order(self.from_s, self.until_s)


class Communication(Section):
    """Who hears whom, and over what. What limits the reach is a model in simulated time, the same over every
    transport; it comes on top of what the real network does."""

    bus: Literal["zenoh", "memory"] = "zenoh"
    listen: Annotated[str, AfterValidator(_listen)] = Field(
        "tcp/127.0.0.1:0",
        description="where operators and sensors reach a flight on the bus zenoh: tcp/HOST:PORT, or none; "
        "port 0: any free one",
    )
    router: Endpoint | None = Field(
        None,
        description="star: where `swarmctl router` listens and every `swarmctl agent` connects: "
        "tcp/HOST:PORT, tls/HOST:PORT or quic/HOST:PORT",
    )
    mesh: Annotated[dict[str, Endpoint], BeforeValidator(_worded)] = Field(
        {},
        description="ad-hoc mesh, instead of a router: where each `swarmctl agent` listens, by its vehicle's "
        "name or system id; of each two the one of the higher system id connects",
    )
    keys: str | None = Field(
        None,
        description="folder that `swarmctl keys` made: mutual TLS and signed messages, with router or mesh, "
        "and signed evidence; default: neither",
    )
    clock_tolerance_s: float = Field(
        5.0,
        gt=0.0,
        description="how far ahead another machine's clock may be; later messages are refused [s]",
    )
    range: Literal["all"] | Annotated[int, Field(ge=0)] = Field(
        "all", description="how many UAVs, the nearest alive ones by last known position, a UAV can send to"
    )
    max_distance_m: float | None = Field(
        None,
        gt=0.0,
        description="radio range: farther apart, UAVs do not hear each other; default: no limit [m]",
    )
    min_distance_m: float = Field(
        0.0,
        ge=0.0,
        description="the paper's minimum distance for information exchange: two UAVs that are nearer to each "
        "other than this do not exchange [m]",
    )
    delay_s: float = Field(0.0, ge=0.0, le=MAX_DELAY_S, description="from sending to hearing [s]")
    jitter_s: float = Field(
        0.0, ge=0.0, le=MAX_DELAY_S, description="up to so much more, drawn for each message; may reorder [s]"
    )
    loss: float = Field(0.0, ge=0.0, lt=1.0, description="share of messages that are lost")
    loss_burst: float | None = Field(
        None,
        ge=1.0,
        description="how many messages in a row are lost on average (Gilbert's model), at least "
        "loss / (1 - loss); default: each is drawn for itself",
    )
    bandwidth_bytes_s: float | None = Field(
        None,
        gt=0.0,
        description="what a UAV can send, to each receiver by itself; what would wait longer than 2 s is "
        "dropped; default: no limit [bytes/s]",
    )
    partitions: tuple[PartitionSection, ...] = Field((), description="times at which the swarm falls apart")
    quiet: tuple[QuietSection, ...] = Field((), description="times at which UAVs send nothing")
    relay: bool = Field(
        False, description="whether UAVs pass on at once what they hear of others; where not all reach all"
    )
    sync_every_s: float = Field(
        3.0,
        ge=0.0,
        description="how often a UAV compares what it knows with a neighbour; 0: never, and nothing lost is "
        "asked for, as in the paper [s]",
    )
    penalty_per_m: float = Field(
        0.0, ge=0.0, description="cost of communicating a metre flown; reported only"
    )

    def model_post_init(self, _context: object) -> None:
        if self.router is not None and self.mesh:
            raise ValueError("router makes a star and mesh does without; give one of them")
        if self.max_distance_m is not None and self.min_distance_m >= self.max_distance_m:
            raise ValueError(
                f"min_distance_m {self.min_distance_m:g} leaves nothing below max_distance_m "
                f"{self.max_distance_m:g}"
            )
        if self.loss_burst is not None and self.loss == 0.0:
            raise ValueError("loss_burst says how losses cluster; give loss too")
