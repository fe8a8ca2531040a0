"""Tests of local metres against published lengths of degrees and against geodesics of another program."""

import numpy as np
import pytest

from thalweg.world.real import geodesy

DEGREE_M = [
    (0, 110_574, 111_320),
    (15, 110_649, 107_550),
    (30, 110_852, 96_486),
    (45, 111_132, 78_847),
    (60, 111_412, 55_800),
    (75, 111_618, 28_902),
]
"""Latitude, and the lengths there of a degree of latitude and of longitude on WGS84, as tables print them."""

GEODESICS = [
    ((7.0, 45.0), (7.1, 45.0), 7884.6830),
    ((7.0, 44.95), (7.0, 45.05), 11113.1777),
    ((0.0, 0.0), (0.05, 0.0), 5565.9745),
    ((151.0, -33.9), (151.06, -33.95), 7844.6464),
    ((18.9, 69.6), (19.02, 69.65), 7271.2584),
    ((179.97, 65.0), (-179.96, 65.02), 3983.6164),
    ((10.0, 60.0), (10.0, 60.0466), 5191.8310),
]
"""Two places, longitude first, and the shortest way between them in metres, computed by GeographicLib 2."""


@pytest.mark.parametrize(("latitude", "north_m", "east_m"), DEGREE_M)
def test_a_degree_is_as_long_as_tables_say(latitude, north_m, east_m):
    half = 0.025
    north = np.array([[20.0, latitude - half], [20.0, latitude + half]])
    east = np.array([[20.0 - half, latitude], [20.0 + half, latitude]])
    assert geodesy.chord_lengths(north)[0] / (2 * half) == pytest.approx(north_m, abs=0.6)
    assert geodesy.chord_lengths(east)[0] / (2 * half) == pytest.approx(east_m, abs=0.6)


@pytest.mark.parametrize(("one", "other", "metres"), GEODESICS)
def test_distances_are_those_of_geodesics_to_two_millimetres(one, other, metres):
    places = np.array([one, other])
    places[:, 0] = np.unwrap(places[:, 0], period=360.0)
    assert geodesy.chord_lengths(places)[0] == pytest.approx(metres, abs=2e-3)
    local = geodesy.local_metres(places, places.mean(axis=0))
    assert np.hypot(*(local[1] - local[0])) == pytest.approx(metres, abs=2e-3)


def test_x_is_east_and_y_is_north_of_the_origin():
    around = np.array([[-70.0, -30.0], [-69.99, -30.0], [-70.0, -29.99]])
    local = geodesy.local_metres(around, around[0])
    np.testing.assert_allclose(local, [[0, 0], [964.86, 0], [0, 1108.52]], atol=0.1)


def test_the_projection_error_grows_with_the_cube_of_the_distance():
    quarter = np.array([[0.0, 0.0], [90.0, 0.0]])
    assert geodesy.local_metres(quarter, quarter[0])[1, 0] == pytest.approx(6378137.0)
    assert geodesy.chord_lengths(quarter)[0] == pytest.approx(6378137.0 * np.sqrt(2))
    ten_km = np.degrees(10_000.0 / 6378137.0)
    drawn = geodesy.local_metres(np.array([[ten_km, 0.0]]), np.zeros(2))[0, 0]
    assert 10_000.0 - drawn == pytest.approx(10_000.0**3 / (6 * 6378137.0**2), rel=1e-3)


def test_the_pole_is_half_a_minor_axis_from_the_centre():
    np.testing.assert_allclose(geodesy.earth_centred(np.array([[123.0, 90.0]])), [[0, 0, 6356752.3142]], atol=1e-3)


@pytest.mark.parametrize("origin", [(11.0, 48.0), (-179.999, -33.0), (0.0, 89.9), (30.0, 0.0)])
def test_metres_turn_back_into_degrees(origin):
    places = np.array([[0.0, 0.0], [5000.0, 0.0], [-300.0, 8000.0], [12.0, -9000.0]])
    degrees = geodesy.degrees_of(places, np.array(origin))
    np.testing.assert_allclose(geodesy.local_metres(degrees, np.array(origin)), places, atol=1e-6)
    np.testing.assert_allclose(degrees[0], origin, atol=1e-12)


def test_a_place_beyond_the_earths_edge_has_no_degrees():
    assert np.isnan(geodesy.degrees_of(np.array([[7e6, 0.0]]), np.array([11.0, 48.0]))).all()
