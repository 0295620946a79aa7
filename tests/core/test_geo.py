import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from swarmctl.core.geo import LocalFrame, distance_m

QUICK = settings(max_examples=examples(40), deadline=None, derandomize=True)


@QUICK
@given(
    lat=st.floats(-85, 85),
    lon=st.floats(-179.9, 179.9),
    east=st.floats(-2e4, 2e4),
    north=st.floats(-2e4, 2e4),
)
def test_a_conversion_and_its_inverse_give_the_same_point(
    lat: float, lon: float, east: float, north: float
) -> None:
    frame = LocalFrame(lat, lon)
    assert frame.to_local(*frame.to_geodetic(east, north)) == pytest.approx((east, north), abs=1e-4)


@QUICK
@given(lat=st.floats(-85, 85), east=st.floats(-2e4, 2e4), north=st.floats(-2e4, 2e4))
def test_a_metre_from_the_origin_is_a_metre_on_the_ground(lat: float, east: float, north: float) -> None:
    frame = LocalFrame(lat, 8.5)
    assert distance_m((lat, 8.5), frame.to_geodetic(east, north)) == pytest.approx(
        np.hypot(east, north), abs=1e-3
    )


def test_axes_point_north_and_east() -> None:
    frame = LocalFrame(47.0, 8.0)
    lat, lon = frame.to_geodetic(0.0, 1000.0)
    assert lat > 47.0
    assert lon == pytest.approx(8.0)
    lat, lon = frame.to_geodetic(1000.0, 0.0)
    assert lon > 8.0
    assert lat == pytest.approx(47.0, abs=1e-5)


def test_arrays_and_single_points_give_equal_results() -> None:
    frame = LocalFrame(-35.36, 149.16)
    east, north = np.array([0.0, 120.0, -40.0]), np.array([0.0, 33.0, 900.0])
    lats, lons = frame.to_geodetic(east, north)
    assert [tuple(p) for p in np.stack([lats, lons], axis=1)] == [
        frame.to_geodetic(e, n) for e, n in zip(east.tolist(), north.tolist(), strict=True)
    ]
    back_east, back_north = frame.to_local(lats, lons)
    np.testing.assert_allclose([back_east, back_north], [east, north], atol=1e-6)


def test_one_degree_of_latitude_at_the_equator() -> None:
    assert distance_m((0.0, 10.0), (1.0, 10.0)) == pytest.approx(110574.4, abs=0.5)


@pytest.mark.parametrize(("lat", "lon"), [(91.0, 0.0), (0.0, 181.0), (float("nan"), 0.0)])
def test_an_origin_off_the_globe_is_refused(lat: float, lon: float) -> None:
    with pytest.raises(ValueError, match=rf"\({lat}, {lon}\)"):
        LocalFrame(lat, lon)
