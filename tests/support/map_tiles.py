"""A made-up MBTiles file."""

from __future__ import annotations

import sqlite3
import struct
import zlib
from contextlib import closing
from pathlib import Path


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


RED = (
    b"\x89PNG\r\n\x1a\n"
    + _chunk(b"IHDR", struct.pack(">IIBBBBB", 1, 1, 8, 2, 0, 0, 0))
    + _chunk(b"IDAT", zlib.compress(b"\0\xff\0\0"))
    + _chunk(b"IEND", b"")
)
"""a picture of one red pixel"""


def mbtiles(path: Path, kind: str = "png", tiles: tuple[tuple[int, int, int], ...] = ((3, 4, 2),)) -> Path:
    with closing(sqlite3.connect(path)) as database:
        database.execute("CREATE TABLE metadata (name text, value text)")
        database.execute("CREATE TABLE tiles (zoom_level int, tile_column int, tile_row int, tile_data blob)")
        database.execute("INSERT INTO metadata VALUES ('format', ?), ('attribution', 'made up')", (kind,))
        database.executemany("INSERT INTO tiles VALUES (?, ?, ?, ?)", [(*tile, RED) for tile in tiles])
        database.commit()
    return path
