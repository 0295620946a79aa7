"""What is wrong with the section `communication` of a configuration, before anything starts. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from swarmctl.bus.endpoint import NO_ENDPOINT, parse_endpoint
from swarmctl.bus.radio import gilbert_probabilities
from swarmctl.config.communication import Communication, Uav
from swarmctl.config.mesh import vehicle_of
from swarmctl.config.model import Config, ConfigProblem
from swarmctl.config.yaml_lines import Path as KeyPath

HERE: KeyPath = ("communication",)
MAX_SAID = 10


def check_communication(config: Config) -> Iterator[ConfigProblem]:
    """Whether everybody meant is there, and whether the parts of the section fit each other."""
    communication, names = config.communication, _names(config)
    yield from _judge_radio(communication)
    yield from _judge_transport(communication)
    if names:  # else that there is no vehicle is what is wrong
        yield from _judge_times(communication, names)
        yield from _judge_mesh(communication, names)


def _names(config: Config) -> dict[int, str]:
    """System id: name, of all vehicles."""
    count = config.simulate.count if config.simulate is not None else 0
    simulated = {n: f"uav{n}" for n in range(1, count + 1)}
    return {vehicle.sysid: vehicle.name for vehicle in config.vehicles} | simulated


def _judge_radio(c: Communication) -> Iterator[ConfigProblem]:
    try:
        gilbert_probabilities(c.loss, c.loss_burst)
    except ValueError as error:
        yield ConfigProblem((*HERE, "loss_burst"), str(error), given=(*HERE, "loss"))
    if 0.0 < c.sync_every_s < c.delay_s:
        text = f"{c.sync_every_s:g} is shorter than delay_s = {c.delay_s:g}: a UAV would ask again before "
        text += f"its question is heard; give at least {c.delay_s:g}, or 0 to ask for nothing"
        yield ConfigProblem((*HERE, "sync_every_s"), text, given=(*HERE, "delay_s"))


def _judge_transport(c: Communication) -> Iterator[ConfigProblem]:
    if c.bus == "memory":
        for key, given in (("router", c.router is not None), ("mesh", bool(c.mesh))):
            if given:
                text = "bus: memory stays within one process; give bus: zenoh, or leave this away"
                yield ConfigProblem((*HERE, key), text, given=(*HERE, "bus"))
    between: dict[KeyPath, str] = {(*HERE, "mesh", who): endpoint for who, endpoint in c.mesh.items()}
    if c.router is not None:
        between[*HERE, "router"] = c.router
    if _is_certified(c.listen):
        text = f"{c.listen}: a flight in one process is reached over tcp/ alone; give tcp/HOST:PORT, or none"
        yield ConfigProblem((*HERE, "listen"), text)
    if c.keys is None:
        for path, endpoint in between.items():
            if _is_certified(endpoint):
                text = f"{endpoint} needs certificates; give communication.keys the folder that "
                yield ConfigProblem(path, f"{text}`swarmctl keys` made, or write tcp/", given=(*HERE, "keys"))
        return
    for path, endpoint in between.items():
        if not _is_certified(endpoint):
            text = f"{endpoint} would not use communication.keys; write tls/ or quic/ instead of tcp/"
            yield ConfigProblem(path, f"{text}, or leave keys away", given=(*HERE, "keys"))
    if not between and c.listen != NO_ENDPOINT and not parse_endpoint(c.listen).is_loopback:
        text = f"others than this machine reach {c.listen}, and communication.keys does not keep them away: "
        text += "without router or mesh it signs the evidence alone; give tcp/127.0.0.1:0, or leave keys away"
        yield ConfigProblem((*HERE, "listen"), text, given=(*HERE, "keys"))


def _is_certified(text: str) -> bool:
    """Whether both sides show certificates at this endpoint; where nobody listens, nobody does."""
    return text != NO_ENDPOINT and parse_endpoint(text).is_certified


def _judge_times(c: Communication, names: Mapping[int, str]) -> Iterator[ConfigProblem]:
    """Whether partitions and quiet times speak of vehicles, and of each once."""
    for i, partition in enumerate(c.partitions):
        here: KeyPath = (*HERE, "partitions", i, "groups")
        words = {
            (*here, j, k): word for j, group in enumerate(partition.groups) for k, word in enumerate(group)
        }
        uavs, unknown = _meant(words, names)
        yield from unknown
        yield from _judge_once(uavs, names, "a UAV is in one group of a partition, once")
    for i, quiet in enumerate(c.quiet):
        uavs, unknown = _meant(
            {(*HERE, "quiet", i, "uavs", k): word for k, word in enumerate(quiet.uavs)}, names
        )
        yield from unknown
        yield from _judge_once(uavs, names, "once is enough")


def _judge_mesh(c: Communication, names: Mapping[int, str]) -> Iterator[ConfigProblem]:
    """Whether each vehicle has an endpoint of its own."""
    if not c.mesh:
        return
    here: KeyPath = (*HERE, "mesh")
    uavs, unknown = _meant({(*here, word): word for word in c.mesh}, names)
    yield from unknown
    yield from _judge_once(uavs, names, "a vehicle listens at one endpoint")
    missing = [name for uav, name in names.items() if uav not in uavs.values()]
    if missing and not unknown:
        more = f" and {len(missing) - MAX_SAID} more" if len(missing) > MAX_SAID else ""
        text = f"{', '.join(missing[:MAX_SAID])}{more} cannot be found by the others"
        yield ConfigProblem(here, f"{text}; give each vehicle an endpoint", given=("vehicles",))
    first: dict[str, str] = {}
    for word, text in c.mesh.items():
        endpoint = str(parse_endpoint(text))
        if first.setdefault(endpoint, word) != word:
            yield ConfigProblem(
                (*here, word), f"{endpoint} is {first[endpoint]}'s; give each vehicle its own"
            )


def _meant(
    words: Mapping[KeyPath, Uav], names: Mapping[int, str]
) -> tuple[dict[KeyPath, int], list[ConfigProblem]]:
    """The vehicle that each word means, by where the word stands; and words that mean none, or two."""
    uavs: dict[KeyPath, int] = {}
    problems = []
    for path, word in words.items():
        try:
            uavs[path] = vehicle_of(word, names)
        except ValueError as error:
            problems.append(ConfigProblem(path, str(error), given=("vehicles",)))
    return uavs, problems


def _judge_once(uavs: Mapping[KeyPath, int], names: Mapping[int, str], rule: str) -> Iterator[ConfigProblem]:
    seen: set[int] = set()
    for path, uav in uavs.items():
        if uav in seen:
            yield ConfigProblem(path, f"{names[uav]} is given twice; {rule}", given=("vehicles",))
        seen.add(uav)
