"""What a kind of link needs installed beside this program."""

from __future__ import annotations

from importlib.util import find_spec

NEEDS = {"mavsdk": "mavsdk"}
"""the package, by the link that imports it"""


def missing(link: str) -> str:
    """What is not installed of what this link needs, and what to do; empty where nothing is."""
    package = NEEDS.get(link)
    if package is None or _is_there(package):
        return ""
    return (
        f"`link: {link}` needs the package {package}: pip install 'mavlink-swarmctl[{package}]', or "
        "`link: direct`"
    )


def _is_there(package: str) -> bool:
    try:
        return find_spec(package) is not None
    except ValueError:  # loaded by hand, without saying from where
        return True
