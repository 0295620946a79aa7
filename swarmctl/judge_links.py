"""What is wrong with the section `links` beside the vehicles of a configuration. Pure."""

from __future__ import annotations

from collections.abc import Iterator

from swarmctl.config import Config, Problem
from swarmctl.links.url import parse_url


def judge_links(config: Config) -> Iterator[Problem]:
    if config.links.signing_key is not None and config.simulate is not None:
        text = (
            "vehicles of `simulate` have no key, so that nothing they say would be heard; leave it away, or "
            "list vehicles that have it"
        )
        yield Problem(("links", "signing_key"), text)
    vehicles = {parse_url(vehicle.url) for vehicle in config.vehicles}
    for i, url in enumerate(config.links.forward):
        if parse_url(url) in vehicles:
            text = f"{url} is where vehicles are; give the program that watches a place of its own"
            yield Problem(("links", "forward", i), text)
