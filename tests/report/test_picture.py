import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.lines import Line2D
from matplotlib.text import Text
from numpy.typing import NDArray
from profiles import full_only

from swarmctl.core.belief import CLEAR, OCCUPIED, UNKNOWN
from swarmctl.core.grid import Cell, Grid
from swarmctl.core.records import replace
from swarmctl.report.pictures.scene import MapPicture, PlannedTrack, VehicleTrack
from swarmctl.report.pictures.sheet import draw_map, figure_of


def picture(n_vehicles: int = 2, rows: int = 20, cols: int = 20, **changes: object) -> MapPicture:
    """Return a map with a found hostile at (15, 5), another at (15, 15), and an observed west half."""
    grid = Grid(rows, cols, 50.0, 47.4, 8.5)
    known = np.full((rows, cols), UNKNOWN, dtype=np.int8)
    known[:, : cols // 2] = CLEAR
    known[15 * rows // 20, 5 * cols // 20] = OCCUPIED
    tracks = []
    for index in range(n_vehicles):
        row = index * (rows // 2) // n_vehicles
        start = grid.frame.to_geodetic(-60.0, (row + 0.5) * 50.0)
        line = [start, grid.centre((row, 0)), grid.centre((row, cols - 1))]
        tracks.append(
            VehicleTrack(
                name=f"uav{index + 1}",
                start=start,
                goal_cells=[(row, cols - 1)],
                planned=[PlannedTrack("first route", line)],
                flown=line,
                strikes=[grid.centre((row, min(3, cols - 1)))],
                outcome="landed, 1 strike",
            )
        )
    hostiles = frozenset({(15 * rows // 20, 5 * cols // 20), (15 * rows // 20, 15 * cols // 20)})
    made = MapPicture(
        grid, hostiles, known, tracks, "First flight", f"{n_vehicles} vehicles · w = 0.5 · seed 7"
    )
    return replace(made, **changes)


def cell_pixels(path: Path, shown: MapPicture, cell: Cell) -> NDArray[np.int64]:
    """Return the pixels of a cell without its rim, (n, n, 3), 0 to 255."""
    pixels = np.asarray(np.round(imread(path)[..., :3] * 255), dtype=np.int64)
    to_pixels = figure_of(shown).axes[0].transData.transform
    size, (row, col) = shown.grid.cell_size_m, cell
    left, below = to_pixels(((col + 0.2) * size, (row + 0.2) * size))
    right, above = to_pixels(((col + 0.8) * size, (row + 0.8) * size))
    high = pixels.shape[0]
    return pixels[round(high - above) : round(high - below), round(left) : round(right)]


def is_grey(colour: NDArray[np.int64]) -> bool:
    return bool(np.ptp(colour) == 0 and 0 < colour[0] < 255)


@pytest.mark.full
def test_cells_are_shaded_as_in_figure_8(tmp_path: Path) -> None:
    shown = picture()
    draw_map(tmp_path / "map.png", shown)

    def pixels(cell: Cell) -> NDArray[np.int64]:
        return cell_pixels(tmp_path / "map.png", shown, cell)

    found, not_found = pixels((15, 5)), pixels((15, 15))
    assert is_grey(found[0, 0])
    assert (found == found[0, 0]).all()
    assert is_grey(not_found[0, 0])
    assert (not_found == not_found[0, 0]).all()
    assert found[0, 0, 0] < not_found[0, 0, 0]  # hostiles that were not found are drawn fainter
    assert (pixels((12, 5)) == 255).all()  # white: seen, no threat
    for first_neighbour in ((14, 5), (16, 5), (15, 4), (15, 6)):
        rows_of_pixels = pixels(first_neighbour)
        assert (rows_of_pixels == rows_of_pixels[:, :1]).all()  # level lines: nothing changes along a row
        assert np.ptp(rows_of_pixels[:, 0, 0]) > 0
    for second_neighbour in ((14, 4), (14, 6), (16, 4), (16, 6)):
        columns_of_pixels = pixels(second_neighbour)
        assert (columns_of_pixels == columns_of_pixels[:1]).all()
        assert np.ptp(columns_of_pixels[0, :, 0]) > 0


def test_unobserved_cells_are_tinted(tmp_path: Path) -> None:
    shown = picture()
    draw_map(tmp_path / "map.png", shown)
    unseen = cell_pixels(tmp_path / "map.png", shown, (12, 12))
    assert (unseen == unseen[0, 0]).all()
    assert not (unseen == 255).all()


def test_without_the_truth_only_found_hostiles_are_shaded(tmp_path: Path) -> None:
    shown = picture(hostiles=None)
    draw_map(tmp_path / "map.png", shown)
    assert is_grey(cell_pixels(tmp_path / "map.png", shown, (15, 5))[0, 0])
    unseen = cell_pixels(tmp_path / "map.png", shown, (12, 12))
    assert (cell_pixels(tmp_path / "map.png", shown, (15, 15))[:5, :5] == unseen[:5, :5]).all()


def test_equal_pictures_give_equal_bytes(tmp_path: Path) -> None:
    draw_map(tmp_path / "one.png", picture())
    draw_map(tmp_path / "two.png", picture())
    draw_map(tmp_path / "other.png", picture(title="Second flight"))
    one = (tmp_path / "one.png").read_bytes()
    assert one == (tmp_path / "two.png").read_bytes()
    assert one != (tmp_path / "other.png").read_bytes()


SIZES = [
    (40, 20, 20),
    (3, 2, 40),
    (3, 40, 2),
    *full_only((1, 20, 20), (5, 20, 20), (20, 20, 20), (20, 100, 100)),
]


def texts_of(axes: Axes) -> list[Text]:
    return [text for text in axes.texts if text.get_text()]


def legend_texts(figure: Figure) -> list[Text]:
    return [text for legend in figure.legends for text in legend.get_texts() if text.get_text()]


def legend_of(shown: MapPicture) -> list[str]:
    return [text.get_text() for text in legend_texts(figure_of(shown))]


LONG = "failed: the mission is not accepted after 3 attempts [upload-failed]; returned and landed at home"


@pytest.mark.parametrize("outcome", ["landed, 1 strike", LONG])
@pytest.mark.parametrize(("n_vehicles", "rows", "cols"), SIZES)
def test_the_legend_lies_outside_the_map_and_nothing_in_it_overlaps_or_is_cut_off(
    n_vehicles: int, rows: int, cols: int, outcome: str
) -> None:
    shown = picture(n_vehicles, rows, cols)
    tracks = [replace(track, outcome=outcome) for track in shown.tracks]
    figure = figure_of(replace(shown, tracks=tracks))
    figure.draw_without_rendering()
    chart, *keys = figure.axes
    map_box = chart.get_window_extent()
    assert figure.legends
    texts = [*legend_texts(figure), *figure.texts, *(text for key in keys for text in texts_of(key))]
    boxes = [text.get_window_extent() for text in texts]
    wide, high = figure.bbox.width, figure.bbox.height
    for index, box in enumerate(boxes):
        assert not box.overlaps(map_box)
        assert 0 <= box.x0 <= box.x1 <= wide
        assert 0 <= box.y0 <= box.y1 <= high
        assert not any(box.overlaps(other) for other in boxes[:index])


def counts_of(legend: list[str]) -> list[int]:
    """Return the counts in parentheses of a legend, in ascending order."""
    return sorted(int(count) for count in re.findall(r"\((\d+)", " ".join(legend)))


def test_the_legend_has_every_vehicle_and_only_the_marks_on_the_map() -> None:
    everything = legend_of(picture())
    assert all(any(f"{name}   landed, 1 strike" == text for text in everything) for name in ("uav1", "uav2"))
    assert "first route" in everything
    # hostiles found and not found, strikes, cells seen and not seen
    assert counts_of(everything) == [1, 1, 2, 200, 200]
    bare = legend_of(picture(n_vehicles=0, hostiles=frozenset(), known=np.zeros((20, 20), dtype=np.int8)))
    assert counts_of(bare) == [400]
    assert any(" 11 " in text for text in legend_of(picture(n_vehicles=40)))


@pytest.mark.parametrize("n_vehicles", [1, 5, 20])
def test_a_long_outcome_stands_whole_in_the_legend(n_vehicles: int) -> None:
    shown = picture(n_vehicles)
    tracks = [replace(track, outcome=LONG) for track in shown.tracks]
    words = " ".join(legend_of(replace(shown, tracks=tracks))).split()
    assert " ".join(words).count(LONG) == n_vehicles


def test_the_legend_explains_line_widths_where_they_differ() -> None:
    assert any("widths" in text for text in legend_of(picture(2)))
    assert not any("widths" in text for text in legend_of(picture(1)))


def test_a_cell_wrongly_taken_for_a_hostile_is_outlined_and_in_the_legend() -> None:
    shown = picture()
    known = shown.known.copy()
    known[3, 3] = OCCUPIED
    mistaken = figure_of(replace(shown, known=known))
    legend = [text.get_text() for text in legend_texts(mistaken)]
    before = legend_of(shown)
    assert len(legend) == len(before) + 1
    assert counts_of(legend) == sorted([*counts_of(before), 1])
    assert len(mistaken.axes[0].patches) == len(figure_of(shown).axes[0].patches) + 1


def test_the_flown_track_runs_over_the_cells_it_covered(tmp_path: Path) -> None:
    shown = picture(n_vehicles=1)
    draw_map(tmp_path / "map.png", shown)
    pixels = cell_pixels(tmp_path / "map.png", shown, (0, 10))
    middle, edge = pixels[pixels.shape[0] // 2], pixels[0]
    assert (middle == (0, 0x72, 0xB2)).all()
    assert not (edge == (0, 0x72, 0xB2)).all(axis=-1).any()


def test_a_lost_vehicles_track_ends_with_a_mark_of_its_own() -> None:
    shown = picture(n_vehicles=2)

    def drawn(*lost: bool) -> tuple[list[bool], list[bool]]:
        """Return of each end mark, in the legend and on the map, whether it is the white one."""
        tracks = [replace(track, is_lost=is_lost) for track, is_lost in zip(shown.tracks, lost, strict=True)]
        figure = figure_of(replace(shown, tracks=tracks))
        chart = figure.axes[0]
        legend = [line for each in figure.legends for line in each.findobj(Line2D)]
        return tuple(
            [line.get_markerfacecolor() == "white" for line in lines if line.get_marker() == "s"]
            for lines in (legend, chart.lines)
        )

    assert drawn(False, False) == ([False], [False, False])
    assert drawn(False, True) == ([False, True], [False, True])
    assert drawn(True, True) == ([True], [True, True])


def test_numbers_of_vehicles_with_one_start_do_not_overlap() -> None:
    shown = picture(n_vehicles=6)
    start = shown.tracks[0].start
    together = [replace(track, start=start) for track in shown.tracks]
    chart = figure_of(replace(shown, tracks=together)).axes[0]
    at = chart.transData.transform([text.get_position() for text in texts_of(chart)])
    gaps = np.hypot(*(at[:, None] - at[None, :]).transpose(2, 0, 1))[~np.eye(6, dtype=bool)]
    assert gaps.min() > 0.9 * 11.5 / 72.0 * 160.0
