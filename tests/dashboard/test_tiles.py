"""Background maps: an MBTiles file, and the addresses of tile servers."""

from __future__ import annotations

from pathlib import Path

import pytest
from map_tiles import RED, mbtiles

from swarmctl.dashboard.tiles import Tiles, TilesError, tiles_of


def test_a_tile_is_read_with_rows_from_the_north(tmp_path: Path) -> None:
    tiles = tiles_of(str(mbtiles(tmp_path / "map.mbtiles")))
    assert tiles.read(3, 4, 5) == RED
    assert [tiles.read(*place) for place in ((3, 4, 2), (3, 4, -1), (-1, 0, 0), (99, 0, 0))] == [None] * 4
    assert (tiles.min_zoom, tiles.max_zoom, tiles.media) == (3, 3, "image/png")
    assert tiles.origins == ()


def test_a_tile_server_is_the_only_other_origin() -> None:
    tiles = tiles_of("https://tiles.example:8443/map/{z}/{x}/{y}.png?key=1")
    assert tiles.origins == ("https://tiles.example:8443",)
    assert isinstance(tiles, Tiles)


@pytest.mark.parametrize(
    "text",
    [
        "https://tiles.example/map.png",
        "ftp://tiles.example/{z}/{x}/{y}",
        "https://tiles.example;script-src/{z}/{x}/{y}",
        "https://user:secret@tiles.example/{z}/{x}/{y}",
        "https:///{z}/{x}/{y}",
        "no-such-file.mbtiles",
    ],
)
def test_a_bad_address_is_refused(text: str) -> None:
    with pytest.raises(TilesError):
        tiles_of(text)


def test_a_file_without_pictures_is_refused(tmp_path: Path) -> None:
    (tmp_path / "text.mbtiles").write_text("no database" * 100)
    files = [
        tmp_path / "text.mbtiles",
        mbtiles(tmp_path / "vector.mbtiles", "pbf"),
        mbtiles(tmp_path / "empty.mbtiles", tiles=()),
    ]
    for path in files:
        with pytest.raises(TilesError):
            tiles_of(str(path))
