"""Checks of the section `communication`: radio model, endpoints, keys and names of vehicles. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from swarmctl.bus.endpoint import NO_ENDPOINT, parse_endpoint
from swarmctl.bus.radio import gilbert_probabilities
from swarmctl.bus.transports import BUSES
from swarmctl.config.communication import Communication, VehicleRef, vehicle_of
from swarmctl.config.model import Config
from swarmctl.config.problems import ConfigProblem
from swarmctl.config.yaml_lines import KeyPath
from swarmctl.core.operator_text import listed

SECTION: KeyPath = ("communication",)


def check_communication(config: Config) -> Iterator[ConfigProblem]:
    """Yield problems of the section: contradictions, and names that match no vehicle."""
    communication, names = config.communication, config.names
    yield from _check_radio(communication)
    yield from _check_transport(communication)
    if names:  # another check reports a configuration without vehicles
        yield from _check_period_vehicles(communication, names)
        yield from _check_mesh(communication, names)


def _check_radio(c: Communication) -> Iterator[ConfigProblem]:
    try:
        gilbert_probabilities(c.loss, c.loss_burst)
    except ValueError as error:
        yield ConfigProblem((*SECTION, "loss_burst"), str(error), depends_on=(*SECTION, "loss"))
    if 0.0 < c.sync_every_s < c.delay_s:
        text = f"{c.sync_every_s:g} is shorter than delay_s = {c.delay_s:g}: a UAV would repeat a request "
        text += f"before the first arrives; give {c.delay_s:g} or more, or 0 for no such requests"
        yield ConfigProblem((*SECTION, "sync_every_s"), text, depends_on=(*SECTION, "delay_s"))


def _check_transport(c: Communication) -> Iterator[ConfigProblem]:
    if not BUSES[c.bus].is_networked:
        for key, given in (("router", c.router is not None), ("mesh", bool(c.mesh))):
            if given:
                text = f"bus: {c.bus} stays within one process; write bus: zenoh, or remove this key"
                yield ConfigProblem((*SECTION, key), text, depends_on=(*SECTION, "bus"))
    endpoints: dict[KeyPath, str] = {(*SECTION, "mesh", word): text for word, text in c.mesh.items()}
    if c.router is not None:
        endpoints[*SECTION, "router"] = c.router
    if _is_certified(c.listen):
        text = f"{c.listen}: a flight in one process listens over tcp/ only; give tcp/HOST:PORT, or none"
        yield ConfigProblem((*SECTION, "listen"), text)
    if c.keys is None:
        for path, endpoint in endpoints.items():
            if _is_certified(endpoint):
                text = f"{endpoint} needs certificates; set communication.keys to the folder that "
                yield ConfigProblem(
                    path, f"{text}`swarmctl keys` made, or write tcp/", depends_on=(*SECTION, "keys")
                )
        return
    for path, endpoint in endpoints.items():
        if not _is_certified(endpoint):
            text = f"{endpoint} does not use communication.keys; write tls/ or quic/ instead of tcp/"
            yield ConfigProblem(path, f"{text}, or remove keys", depends_on=(*SECTION, "keys"))
    if not endpoints and c.listen != NO_ENDPOINT and not parse_endpoint(c.listen).is_loopback:
        text = f"other machines reach {c.listen}, and communication.keys does not protect this endpoint: "
        text += "without router or mesh the keys only sign the evidence; give tcp/127.0.0.1:0, or remove keys"
        yield ConfigProblem((*SECTION, "listen"), text, depends_on=(*SECTION, "keys"))


def _is_certified(text: str) -> bool:
    """Return whether both sides of a connection need certificates; False for `none`."""
    return text != NO_ENDPOINT and parse_endpoint(text).is_certified


def _check_period_vehicles(c: Communication, names: Mapping[int, str]) -> Iterator[ConfigProblem]:
    """Yield problems of vehicles in partitions and quiet times: unknown, or named twice."""
    for i, partition in enumerate(c.partitions):
        here: KeyPath = (*SECTION, "partitions", i, "groups")
        words = {
            (*here, j, k): word for j, group in enumerate(partition.groups) for k, word in enumerate(group)
        }
        uavs, unknown = _resolve(words, names)
        yield from unknown
        yield from _check_once(uavs, names, "list a UAV once in a partition")
    for i, quiet in enumerate(c.quiet):
        uavs, unknown = _resolve(
            {(*SECTION, "quiet", i, "uavs", k): word for k, word in enumerate(quiet.uavs)}, names
        )
        yield from unknown
        yield from _check_once(uavs, names, "list a UAV once")


def _check_mesh(c: Communication, names: Mapping[int, str]) -> Iterator[ConfigProblem]:
    """Yield problems of the mesh: unknown vehicles, and missing, repeated or shared endpoints."""
    if not c.mesh:
        return
    here: KeyPath = (*SECTION, "mesh")
    uavs, unknown = _resolve({(*here, word): word for word in c.mesh}, names)
    yield from unknown
    yield from _check_once(uavs, names, "give each vehicle one endpoint")
    missing = [name for uav, name in names.items() if uav not in uavs.values()]
    if missing and not unknown:
        text = f"no endpoint for {listed(missing)}, so the other agents cannot connect"
        yield ConfigProblem(here, f"{text}; give each vehicle an endpoint", depends_on=("vehicles",))
    first: dict[str, str] = {}
    for word, text in c.mesh.items():
        endpoint = str(parse_endpoint(text))
        if first.setdefault(endpoint, word) != word:
            yield ConfigProblem(
                (*here, word),
                f"{endpoint} is also the endpoint of {first[endpoint]}; give each vehicle its own endpoint",
            )


def _resolve(
    words: Mapping[KeyPath, VehicleRef], names: Mapping[int, str]
) -> tuple[dict[KeyPath, int], list[ConfigProblem]]:
    """Return the system id of each vehicle reference, by its path, and problems of the references.

    A reference has a problem if it matches no vehicle, or two.
    """
    uavs: dict[KeyPath, int] = {}
    problems = []
    for path, word in words.items():
        try:
            uavs[path] = vehicle_of(word, names)
        except ValueError as error:
            problems.append(ConfigProblem(path, str(error), depends_on=("vehicles",)))
    return uavs, problems


def _check_once(uavs: Mapping[KeyPath, int], names: Mapping[int, str], rule: str) -> Iterator[ConfigProblem]:
    seen: set[int] = set()
    for path, uav in uavs.items():
        if uav in seen:
            yield ConfigProblem(path, f"{names[uav]} is given twice; {rule}", depends_on=("vehicles",))
        seen.add(uav)
