"""Whether vehicles can arrive together as a configuration says. Pure."""

from __future__ import annotations

from collections.abc import Iterator

from swarmctl.config.model import Config, ConfigProblem


def check_arrival(config: Config) -> Iterator[ConfigProblem]:
    """Each vehicle's speed has to be known, and its time is the swarm's: no bound of its own beside it."""
    if config.arrival is None:
        return
    for i, vehicle in enumerate(config.vehicles):
        if vehicle.speed_m_s is None:
            text = "is missing: with `arrival`, say what it flies over ground at its fastest [m/s]"
            yield ConfigProblem(("vehicles", i, "speed_m_s"), text)
    sections = [(("vehicles", i), vehicle) for i, vehicle in enumerate(config.vehicles)]
    bounded = [(here, section.arrive_within_s, section.arrive_after_s) for here, section in sections]
    if config.simulate is not None:
        simulate = config.simulate
        bounded.append((("simulate",), simulate.arrive_within_s, simulate.arrive_after_s))  # type: ignore[arg-type]
    for here, within_s, after_s in bounded:
        for key, given in (("arrive_within_s", within_s is not None), ("arrive_after_s", after_s > 0.0)):
            if given:
                text = "the vehicles agree on their time by `arrival`; leave this away, or `arrival`"
                yield ConfigProblem((*here, key), text)
