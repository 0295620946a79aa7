"""The section `communication` of a configuration: transport, endpoints, and the model of the radio."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field

from swarmctl.bus.endpoint import NO_ENDPOINT, BusEndpoint, parse_endpoint
from swarmctl.bus.transports import BUSES
from swarmctl.core.operator_text import resolve_vehicles
from swarmctl.core.section import NameIn, Section

MAX_DELAY_S = 60.0


def _listen_endpoint(text: str) -> str:
    if text != NO_ENDPOINT:
        parse_endpoint(text)
    return text


def _connect_endpoint(text: str) -> str:
    endpoint = parse_endpoint(text)
    if endpoint.port == 0:
        raise ValueError(f"{text!r}: other machines connect to this endpoint; give it a port above 0")
    if endpoint.client_endpoint != endpoint:
        raise ValueError(
            f"{text!r}: {endpoint.host} stands for all addresses, so other machines cannot connect to it; "
            "give the address or name of the listening machine"
        )
    return text


def _keys_as_text(value: Any) -> Any:
    """Return the mapping with system ids as text: YAML reads the key of `3: tcp/...` as a number."""
    if not isinstance(value, dict):
        return value
    return {str(key) if type(key) is int else key: endpoint for key, endpoint in value.items()}


def _require_order(from_s: float, until_s: float | None) -> None:
    if until_s is not None and until_s <= from_s:
        raise ValueError(f"until_s {until_s:g} is not after from_s {from_s:g}; give a later until_s")


Endpoint = Annotated[str, AfterValidator(_connect_endpoint)]
VehicleRef = int | str
"""a vehicle by its system id or its name"""


class PartitionSection(Section):
    """A period in which UAVs receive messages of their own group only.

    A UAV outside all groups receives no message. In overlapping periods a message must pass each partition.
    """

    from_s: float = Field(
        ge=0.0, description="First sending time of the period, in simulated seconds since the start [s]."
    )
    until_s: float | None = Field(
        None,
        gt=0.0,
        description="End, in simulated seconds since the start [s]. Default: the end of the flight.",
    )
    groups: tuple[tuple[VehicleRef, ...], ...] = Field(
        min_length=1,
        description="Groups of UAVs, by name or system id. UAVs of one group receive each other's messages.",
    )

    def model_post_init(self, _context: object) -> None:
        _require_order(self.from_s, self.until_s)
        if not all(self.groups):
            raise ValueError("a group is empty; remove it, or list its UAVs")


class QuietSection(Section):
    """A period in which UAVs send nothing, but still receive."""

    uavs: tuple[VehicleRef, ...] = Field(min_length=1, description="The silent UAVs, by name or system id.")
    from_s: float = Field(0.0, ge=0.0, description="Begin, in simulated seconds since the start [s].")
    until_s: float | None = Field(
        None,
        gt=0.0,
        description="End, in simulated seconds since the start [s]. Default: the end of the flight.",
    )

    def model_post_init(self, _context: object) -> None:
        _require_order(self.from_s, self.until_s)


class Communication(Section):
    """The exchange of messages between UAVs: transport, endpoints, and a model of the radio.

    The model works in simulated time and is the same over every transport. Its delays and losses are added to
    those of the real network.
    """

    bus: Annotated[str, NameIn(BUSES)] = Field(
        "zenoh", description="Transport: zenoh, or memory (within one process, without a network)."
    )
    listen: Annotated[str, AfterValidator(_listen_endpoint)] = Field(
        "tcp/127.0.0.1:0",
        description="Endpoint at which a flight listens for operators and sensors, with bus zenoh only: "
        "tcp/HOST:PORT, or none. Port 0 takes any free port.",
    )
    router: Endpoint | None = Field(
        None,
        description="Star: endpoint of `swarmctl router`, to which every `swarmctl agent` connects: "
        "tcp/HOST:PORT, tls/HOST:PORT or quic/HOST:PORT. Default: no router.",
    )
    mesh: Annotated[dict[str, Endpoint], BeforeValidator(_keys_as_text)] = Field(
        {},
        description="Ad-hoc mesh, instead of a router: the endpoint of each vehicle's `swarmctl agent`, by "
        "name or system id. In each pair the agent with the higher system id opens the connection.",
    )
    keys: str | None = Field(
        None,
        description="Folder made by `swarmctl keys`. With keys, router and mesh use mutual TLS, and messages "
        "and evidence are signed. Default: no keys.",
    )
    clock_tolerance_s: float = Field(
        5.0,
        gt=0.0,
        description="Greatest lead of another machine's clock [s]. A message with a later time is refused.",
    )
    range: Literal["all"] | Annotated[int, Field(ge=0)] = Field(
        "all",
        description="Number of UAVs that receive each message: the nearest by last known position, without "
        "failed UAVs; or all.",
    )
    max_distance_m: float | None = Field(
        None,
        gt=0.0,
        description="Radio range [m]. UAVs farther apart do not exchange messages. Default: no limit.",
    )
    min_distance_m: float = Field(
        0.0,
        ge=0.0,
        description="The paper's minimum distance for information exchange [m]. UAVs nearer to each other "
        "do not exchange messages.",
    )
    delay_s: float = Field(
        0.0, ge=0.0, le=MAX_DELAY_S, description="Time from sending to receiving a message [s]."
    )
    jitter_s: float = Field(
        0.0,
        ge=0.0,
        le=MAX_DELAY_S,
        description="Greatest additional delay, drawn for each message [s]. Messages may change order.",
    )
    loss: float = Field(0.0, ge=0.0, lt=1.0, description="Share of messages that are lost, 0 to below 1.")
    loss_burst: float | None = Field(
        None,
        ge=1.0,
        description="Mean number of messages lost in a row (Gilbert's model), at least loss / (1 - loss). "
        "Default: each loss is independent.",
    )
    bandwidth_bytes_s: float | None = Field(
        None,
        gt=0.0,
        description="Send rate of a UAV [bytes/s]. A message is sent to one receiver after the other. A "
        "message that would wait longer than 2 s is dropped. Default: no limit.",
    )
    partitions: tuple[PartitionSection, ...] = Field(
        (), description="Times at which the swarm splits into groups. Default: none."
    )
    quiet: tuple[QuietSection, ...] = Field(
        (), description="Times at which UAVs send nothing. Default: none."
    )
    relay: bool = Field(
        False,
        description="Each UAV forwards received observations at once. Useful if some UAVs cannot reach each "
        "other.",
    )
    sync_every_s: float = Field(
        3.0,
        ge=0.0,
        description="Period at which a UAV compares observations with a neighbour and requests the missing "
        "observations [s]. 0: never, as in the paper; lost messages stay lost.",
    )
    penalty_per_m: float = Field(
        0.0,
        ge=0.0,
        description="Communication penalty per metre flown [1/m]. The summary multiplies it by the flown "
        "distance; planning ignores it.",
    )

    @property
    def spans_machines(self) -> bool:
        """True if the vehicles' agents may run on separate machines."""
        return self.router is not None or bool(self.mesh)

    def model_post_init(self, _context: object) -> None:
        if self.router is not None and self.mesh:
            raise ValueError("router (a star) and mesh exclude each other; remove one of them")
        if self.max_distance_m is not None and self.min_distance_m >= self.max_distance_m:
            raise ValueError(
                f"min_distance_m {self.min_distance_m:g} is not below max_distance_m "
                f"{self.max_distance_m:g}, so no two UAVs exchange messages; lower min_distance_m"
            )
        if self.loss_burst is not None and self.loss == 0.0:
            raise ValueError("loss_burst has no effect without loss; set loss above 0, or remove loss_burst")


def vehicle_of(word: int | str, names: Mapping[int, str]) -> int:
    """Return the system id of the vehicle that `word` names; `names` has all vehicles, by system id.

    Raises ValueError if `word` matches no vehicle, or two.
    """
    (uav,) = resolve_vehicles([word], names)
    return uav


def mesh_endpoints(mesh: Mapping[str, str], names: Mapping[int, str]) -> dict[int, BusEndpoint]:
    """Return the endpoint of each vehicle's agent, by system id.

    Raises ValueError for a key that matches no vehicle or two, for a vehicle with two endpoints, and for a
    malformed endpoint.
    """
    found: dict[int, BusEndpoint] = {}
    for word, endpoint in mesh.items():
        uav = vehicle_of(word, names)
        if uav in found:
            raise ValueError(f"{names[uav]} is given twice; give each vehicle one endpoint")
        found[uav] = parse_endpoint(endpoint)
    return found
