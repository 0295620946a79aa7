"""What is wrong with the folders of keys that are on this machine, before anything needs them."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator, Sequence
from pathlib import Path

from swarmctl.security.files import KeyringError, read
from swarmctl.security.issue import AUTHORITY
from swarmctl.security.participant import load


def troubles(folder: Path, names: Sequence[str], now: dt.datetime) -> Iterator[str]:
    """One line for each of the participants `names` whose keys cannot be used at `now` (an aware datetime).

    Where the keys were made all of them are expected, on other machines at least one.
    """
    there = [name for name in names if (folder / name).is_dir()]
    were_made_here = (folder / AUTHORITY).is_dir()
    authorities: dict[bytes, Path] = {}
    for name in names if were_made_here or not there else there:
        try:
            load(folder, name, now)
            file = folder / name / "ca.pem"
            authorities.setdefault(read(file), file)
        except KeyringError as error:
            yield str(error)
        if not there:
            return  # the first stands for all
    if were_made_here and there:
        file = folder / AUTHORITY / "ca.pem"
        try:
            authorities.setdefault(read(file), file)
        except KeyringError as error:
            yield str(error)
    if len(authorities) > 1:
        files = ", ".join(map(str, authorities.values()))
        yield (
            f"{files} are of different authorities, and who has the one refuses who has the other: copy the "
            "folders of one run of `swarmctl keys` to all machines"
        )
