"""Tests of kinds of banks as data: what is read, what is refused, and how it is written."""

import numpy as np
import pytest

from thalweg.world import WorldError
from thalweg.world.banks import (
    BankReach,
    as_data,
    check_banks,
    has_kind,
    parse_banks,
    quay_run_m,
    quay_slope,
    read_banks,
    text_of,
)

QUAY = BankReach("quay", 120.0, 180.0, "left")


@pytest.mark.parametrize(
    "value",
    [
        "quay_120-180_left",
        "quay 120-180 left",
        " Quay  left 120-180 ",
        QUAY,
        {"kind": "quay", "start_m": 120, "end_m": np.float64(180), "side": "left"},
        [["quay_120.0-180.000_left"]],
    ],
)
def test_a_reach_is_read_from_a_text_a_record_or_a_dictionary(value):
    assert read_banks(value) == (QUAY,)


def test_a_kind_alone_is_all_of_both_banks():
    assert read_banks("meadow") == (BankReach("meadow", 0.0, None, "both"),)
    assert read_banks("reeds_right_50-") == (BankReach("reeds", 50.0, None, "right"),)


@pytest.mark.parametrize("value", [None, (), [], "forest", "forest+forest_left", "meadow+forest"])
def test_forest_alone_is_no_reach(value):
    assert read_banks(value) == ()
    assert text_of(read_banks(value)) == "forest"


def test_what_a_later_reach_covers_is_left_out_and_forest_over_others_stays():
    assert read_banks("quay+meadow+forest_0-50") == read_banks(["meadow", "forest_0-50"])
    assert [reach.kind for reach in read_banks("meadow+forest_0-50")] == ["meadow", "forest"]
    assert [reach.kind for reach in parse_banks("quay+forest")] == ["quay", "forest"]


@pytest.mark.parametrize("text", ["meadow", "reeds_left", "meadow+quay_120-180_left+forest_10.5-20", "quay_50-"])
def test_a_text_survives_reading_and_writing(text):
    assert text_of(read_banks(text)) == text
    assert read_banks(as_data(read_banks(text))) == read_banks(text)


def test_a_reach_is_as_exact_as_its_text():
    reach = BankReach("quay", 5.00049, 9.9996)
    assert reach == BankReach("quay", 5.0, 10.0) and read_banks(reach.text) == (reach,)
    assert text_of((BankReach("quay", 0.0001),)) == "quay"
    with pytest.raises(WorldError, match=r"the reach of quay begins and ends at 5 m"):
        BankReach("quay", 5.0001, 5.0004)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("medow", r"unknown kind 'medow' \(did you mean 'meadow'\?\); known: forest, meadow, reeds, quay"),
        ("", r"'' is no reach; expected a kind, such as meadow"),
        ("meadow+", r"'' is no reach"),
        ("quay 120 left", r"'120' in 'quay 120 left' is neither a span such as 120-180 nor left, right or both"),
        ("quay left right", r"'right' in 'quay left right' is neither"),
        ("quay 5-9 12-15", r"'12-15' in .* is neither"),
        ("quay 5-5", r"the reach of quay begins and ends at 5 m"),
        ("quay 1-2 left x", r"'quay 1-2 left x' is no reach"),
        (3, r"banks are 3; expected a kind"),
        (b"meadow", r"banks are b'meadow'"),
        ([3], r"banks are 3"),
        ({"start_m": 3}, r"\{'start_m': 3\} has no kind; expected one of forest"),
        ({"kind": "quay", "from": 3}, r"unknown key 'from'; known: kind, start_m, end_m, side"),
        ({"kind": "quay", "start_m": -1}, r"start_m of quay is -1; expected metres of at least 0"),
        ({"kind": "quay", "end_m": np.nan}, r"end_m of quay is nan"),
        ({"kind": "quay", "end_m": True}, r"end_m of quay is True"),
        ({"kind": "quay", "start_m": 10**400}, r"start_m of quay is 10{39}; expected metres"),
        ({"kind": "quay", "side": "north"}, r"the side of quay is 'north'; expected both, left, right"),
        (["meadow_left"] * 101, r"101 reaches; limit 100"),
    ],
)
def test_anything_else_is_refused_with_what_would_be_right(value, message):
    with pytest.raises(WorldError, match=message):
        read_banks(value)


def test_a_reach_must_lie_on_the_course():
    check_banks(read_banks("quay_0-100+meadow_80-"), 100.0, closed=False)
    check_banks(read_banks("quay_90-10"), 100.0, closed=True)
    check_banks((BankReach("quay", 0.0, 99.9996),), 99.9996, closed=False)
    for text in ("quay_0-101", "quay_100-", "quay_150-20"):
        with pytest.raises(
            WorldError, match=rf"{text} is not on the course, which is 100\.0 m long; expected 0 to 100"
        ):
            check_banks(read_banks(text), 100.0, closed=True)
    with pytest.raises(WorldError, match=r"quay_90-10 ends before it begins; on an open course"):
        check_banks(read_banks("quay_90-10"), 100.0, closed=False)


def test_a_kind_is_found_among_reaches():
    assert has_kind(read_banks("meadow+quay_1-2"), "quay")
    assert not has_kind(read_banks("meadow"), "quay")


def test_a_wall_is_two_nodes_wide_on_a_coarse_map():
    assert quay_slope(0.25) == 2.2
    assert quay_slope(0.5) == pytest.approx(1.15)
    assert quay_run_m(0.25) == pytest.approx(0.25 + 1.15 / 2.2)
