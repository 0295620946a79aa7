"""Background maps: tiles of a URL, for the browser to load, or of an MBTiles file, served by this process."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import msgspec
from fastapi import FastAPI, Response

MAX_ZOOM = 19
"""greatest zoom of a tile server by URL"""
OWN_PATH = "/tiles/{z}/{x}/{y}"
MEDIA = {"png": "image/png", "jpg": "image/jpeg", "jpeg": "image/jpeg", "webp": "image/webp"}


class TilesError(ValueError):
    """Tiles that cannot be shown; the text says what to do."""


class Tiles(msgspec.Struct, frozen=True):
    """Tiles in Web Mercator."""

    template: str
    """address with {z}, {x} and {y}; rows count from the north"""
    min_zoom: int = 0
    max_zoom: int = MAX_ZOOM
    attribution: str = ""
    file: Path | None = None
    """MBTiles file; None: the browser loads the tiles from another server"""
    media: str = ""

    @property
    def origins(self) -> tuple[str, ...]:
        """The other servers from which a browser loads the tiles."""
        if self.file is not None:
            return ()
        address = urlsplit(self.template)
        return (f"{address.scheme}://{address.netloc}",)

    def option(self) -> dict[str, Any]:
        """Return what the map needs."""
        return {
            "template": self.template, "min_zoom": self.min_zoom, "max_zoom": self.max_zoom,
            "attribution": self.attribution,
        }  # fmt: skip

    def add_to(self, application: FastAPI) -> None:
        """Serve the tiles of a file."""
        if self.file is None:
            return

        @application.get(OWN_PATH)
        def tile(z: int, x: int, y: int) -> Response:
            found = self.read(z, x, y)
            if found is None:
                return Response(status_code=404)
            return Response(found, media_type=self.media, headers={"cache-control": "max-age=3600"})

    def read(self, z: int, x: int, y: int) -> bytes | None:
        """Return a tile of the file; its rows count from the south there. None: the file does not have it."""
        assert self.file is not None
        if not (0 <= z <= 30 and 0 <= x < 1 << z and 0 <= y < 1 << z):
            return None
        with closing(_connect(self.file)) as database:
            row = database.execute(
                "SELECT tile_data FROM tiles WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?",
                (z, x, (1 << z) - 1 - y),
            ).fetchone()
        return None if row is None else bytes(row[0])


def tiles_of(text: str) -> Tiles:
    """Return the tiles of a URL with {z}, {x} and {y}, or of an MBTiles file. Raises TilesError."""
    if "://" not in text:
        return _of_file(Path(text))
    address = urlsplit(text)
    if address.scheme not in ("http", "https") or not all(part in text for part in ("{z}", "{x}", "{y}")):
        raise TilesError(f"{text}: expected http(s)://HOST/… with {{z}}, {{x}} and {{y}} [tiles-url]")
    # The address becomes a part of the content policy.
    if not address.netloc or any(char in address.netloc for char in " ;,'\"{}@"):
        raise TilesError(f"{text}: expected a host without {{ }}, quotes or a password [tiles-url]")
    return Tiles(text, attribution=f"map: {address.hostname}")


def _of_file(path: Path) -> Tiles:
    try:
        with closing(_connect(path)) as database:
            told = dict(database.execute("SELECT name, value FROM metadata"))
            least, most = database.execute("SELECT min(zoom_level), max(zoom_level) FROM tiles").fetchone()
    except sqlite3.Error as error:
        raise TilesError(f"{path} is no MBTiles file that can be read: {error} [tiles-file]") from error
    media = MEDIA.get(str(told.get("format", "png")))
    if media is None or least is None:
        found = "no tiles" if least is None else f"tiles of the format {told['format']}"
        raise TilesError(f"{path} has {found}; expected pictures: {', '.join(MEDIA)} [tiles-file]")
    return Tiles(OWN_PATH, int(least), int(most), str(told.get("attribution", "")), path, media)


def _connect(path: Path) -> sqlite3.Connection:
    return sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)
