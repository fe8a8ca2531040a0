"""Tests of lists of seeds as people write them."""

from typing import Any

import numpy as np
import pytest

from thalweg.core.seeds import UNSEEN, compact_seeds, parse_seeds, refuse_unseen


@pytest.mark.parametrize(
    ("given", "seeds"),
    [
        (7, (7,)),
        ("7", (7,)),
        ("1000:1003", (1000, 1001, 1002)),
        ("0 5 10:12", (0, 5, 10, 11)),
        (("0", "5", "10:12"), (0, 5, 10, 11)),
        ([0, 5, "10:12"], (0, 5, 10, 11)),
        (range(3, 6), (3, 4, 5)),
        ([range(2), 9], (0, 1, 9)),
        (["1_000:1_002", "2e1"], (1000, 1001, 20)),
        (np.array([4, 2]), (4, 2)),
        (np.array(5), (5,)),
        ((), ()),
        ("1:2", (1,)),
    ],
)
def test_seeds_are_numbers_and_ranges_without_their_end(given: Any, seeds: tuple[int, ...]):
    found = parse_seeds(given)
    assert found == seeds
    assert all(type(seed) is int for seed in found)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("1016:1000", "1016:1000 holds no seed; write 1000:1016"),
        ("5:5", "5:5 holds no seed; its end is excluded: write 5:6"),
        ("0:10:2", "ranges such as 1000:1016, whose end is excluded; not '0:10:2'"),
        ("1000:", "ranges such as 1000:1016"),
        ("_:5", "ranges such as 1000:1016, whose end is excluded; not '_:5'"),
        ("1__0:20", "not '1__0:20'"),
        (f"0:{'9' * 5000}", "ranges such as 1000:1016"),
        (range(10**12), "too many seeds"),
        (range(0, 2_000_001, 2), "too many seeds"),
        ("1000-1016", "ranges such as 1000:1016"),
        ("five", "must be whole numbers of at least 0, or ranges .* not 'five'"),
        ("1.5", "not '1.5'"),
        ([1.5], "not 1.5"),
        ([True], "not True"),
        (None, "not None"),
        ({"a": 1}, "must be a list of seeds and ranges"),
        (-3, "a seed must be 0 or more, not -3"),
        (range(-1, 3), "0 or more, not -1"),
        (range(3, 3), "holds no seed"),
        ([3, "1:5"], "the seed 3 is given twice"),
        ("0:20000000", "too many seeds"),
        ("0:99999999999999999999999", "too many seeds"),
    ],
)
def test_anything_else_is_refused_with_what_is_wrong(given: Any, message: str):
    class Refused(ValueError):
        pass

    with pytest.raises(Refused, match=rf"^--seeds.*({message})"):
        parse_seeds(given, "--seeds", Refused)


@pytest.mark.parametrize(
    ("seeds", "data"),
    [
        (range(1000, 1017), ["1000:1017"]),
        (range(1000, 1016), [*range(1000, 1016)]),
        ([3, *range(50, 80), 2, 1], [3, "50:80", 2, 1]),
        ([], []),
    ],
)
def test_long_runs_of_seeds_are_written_as_ranges_and_read_again(seeds, data):
    assert compact_seeds(seeds) == data
    assert parse_seeds(data) == tuple(seeds)


def test_seeds_of_unseen_rivers_are_refused_for_training():
    refuse_unseen((), "seeds", ValueError)
    refuse_unseen((0, UNSEEN - 1), "seeds", ValueError)
    with pytest.raises(KeyError, match=r"seeds: rivers from seed 100,000 on .* give lower seeds, not 100,000"):
        refuse_unseen((7, UNSEEN), "seeds", KeyError)  # pyright: ignore[reportArgumentType]
