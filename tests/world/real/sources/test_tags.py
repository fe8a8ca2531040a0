"""Tests of the meaning of tags: roles, widths as people write them, and decks."""

import pytest

from thalweg.world import WorldError
from thalweg.world.real.sources.tags import deck_width, metres, role_of


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (14, 14.0), ("14", 14.0), ("14 m", 14.0), ("14m", 14.0), ("14,5 m", 14.5), ("14.25 metres", 14.25),
        ("~10", 10.0), ("46 ft", 14.0208), ("0.02 km", 20.0), ("850 cm", 8.5), ("16'6\"", 5.0292), ("20'", 6.096),
    ],
)  # fmt: skip
def test_widths_are_read_as_people_write_them(value, expected):
    assert metres(value, "width") == pytest.approx(expected)


@pytest.mark.parametrize(
    "value",
    [
        "wide",
        "",
        "10-15",
        "1,200",
        "14 parsecs",
        "-3",
        0,
        -1,
        True,
        None,
        float("nan"),
        float("inf"),
        [4],
        "1e5",
        10**400,
    ],
)
def test_an_unreadable_width_is_refused_by_name(value):
    with pytest.raises(
        WorldError, match=r"^width of way/7 is .*; expected a number of metres above 0, or text such as"
    ):
        metres(value, "width of way/7")


@pytest.mark.parametrize(
    ("kind", "tags", "role"),
    [
        ("line", {}, "way"),
        ("line", {"waterway": "river"}, "way"),
        ("line", {"waterway": "weir"}, "other"),
        ("line", {"waterway": "canal", "bridge": "aqueduct"}, "way"),
        ("line", {"highway": "footway", "bridge": "yes"}, "bridge"),
        ("line", {"highway": "footway", "bridge": "no"}, "other"),
        ("line", {"highway": "footway"}, "other"),
        ("polygon", {}, "banks"),
        ("polygon", {"natural": "water", "water": "river"}, "banks"),
        ("polygon", {"natural": "water"}, "banks"),
        ("polygon", {"natural": "water", "water": "pond"}, "other"),
        ("polygon", {"waterway": "riverbank"}, "banks"),
        ("polygon", {"place": "islet"}, "island"),
        ("polygon", {"building": "yes"}, "other"),
    ],
)
def test_tags_say_what_a_feature_is(kind, tags, role):
    assert role_of(kind, tags) == role


@pytest.mark.parametrize(
    ("tags", "width"),
    [
        ({"width": "4 m", "highway": "residential"}, 4.0),
        ({"highway": "footway"}, 3.0),
        ({"highway": "residential"}, 6.5),
        ({"highway": "primary", "lanes": "3"}, 9.75),
        ({"highway": "primary", "lanes": "9" * 400}, 6.5),
        ({"highway": "primary", "lanes": "0"}, 6.5),
        ({"highway": "primary", "lanes": "2;3"}, 6.5),
        ({"railway": "rail"}, 5.0),
        ({}, 3.2),
    ],
)
def test_a_deck_is_as_wide_as_its_kind_of_way(tags, width):
    assert deck_width(tags, "way/1") == pytest.approx(width)
