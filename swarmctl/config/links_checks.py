"""What is wrong with the section `links` beside the vehicles of a configuration. Pure."""

from __future__ import annotations

from collections.abc import Iterator

from swarmctl.config.links import Links
from swarmctl.config.model import Config, ConfigProblem
from swarmctl.links.forwarding import open_to_strangers
from swarmctl.links.url import parse_url


def check_links(config: Config) -> Iterator[ConfigProblem]:
    # Nobody gives the built-in simulator the key: in `scenario.json` it would lie in the run's folder, and
    # over the link it goes in clear. One that is started by hand, and was given it, is listed as a vehicle.
    if config.links.signing_key is not None and config.simulate is not None:
        text = (
            "vehicles of `simulate` have no key, so that nothing they say would be heard; leave it away, or "
            "list vehicles that have it: also a simulator that you have started and given the key"
        )
        yield ConfigProblem(("links", "signing_key"), text)
    vehicles = {parse_url(vehicle.url) for vehicle in config.vehicles}
    for i, url in enumerate(config.links.forward):
        if parse_url(url) in vehicles:
            text = f"{url} is where vehicles are; give the program that watches a place of its own"
            yield ConfigProblem(("links", "forward", i), text)
        if text := forwarding_problem(config.links, url):
            yield ConfigProblem(("links", "forward", i), text)


def forwarding_problem(links: Links, url: str) -> str:
    """Why traffic may not be forwarded to this URL: strangers could order vehicles; empty where it may."""
    signed = links.signing_key is not None
    return open_to_strangers(parse_url(url), signed=signed) if links.forward_commands else ""
