"""Checks of the section `links` against the vehicles of a configuration. Pure."""

from __future__ import annotations

from collections.abc import Iterator

from swarmctl.config.links import Links
from swarmctl.config.model import Config
from swarmctl.config.problems import ConfigProblem
from swarmctl.links.forwarding import stranger_warning
from swarmctl.links.url import parse_url


def check_links(config: Config) -> Iterator[ConfigProblem]:
    """Yield problems of a signing key beside `simulate`, and of impossible or unsafe forwarding."""
    # The built-in simulator never has the key, because `scenario.json` in the run folder or a message on the
    # link would reveal the key. A simulator that the user starts with the key is a vehicle with a URL.
    if config.links.signing_key is not None and config.simulate is not None:
        text = (
            "vehicles of `simulate` have no signing key, so all their messages would be refused; remove "
            "signing_key, or list vehicles with this key under `vehicles`, such as your own simulator"
        )
        yield ConfigProblem(("links", "signing_key"), text)
    vehicles = {parse_url(vehicle.url) for vehicle in config.vehicles}
    for i, url in enumerate(config.links.forward):
        if parse_url(url) in vehicles:
            text = f"{url} is the URL of a vehicle; give the receiving program another endpoint"
            yield ConfigProblem(("links", "forward", i), text)
        if text := forwarding_problem(config.links, url):
            yield ConfigProblem(("links", "forward", i), text)


def forwarding_problem(links: Links, url: str) -> str:
    """Return the reason why forwarding to this URL is unsafe; empty if forwarding is safe.

    Forwarding is unsafe if other machines could command vehicles through this URL.
    """
    signed = links.signing_key is not None
    return stranger_warning(parse_url(url), signed=signed) if links.forward_commands else ""
