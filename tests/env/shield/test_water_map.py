"""The remembered water: what is entered of a cell, and the window that moves with the vehicle."""

import numpy as np

from thalweg.env.shield.water_map import (
    CELL_M,
    GUESS,
    LAND,
    LEAST,
    MOST,
    NEAR,
    SIZE,
    UNREAD,
    VEIL,
    WATER,
    WET,
    cell_of,
    empty_maps,
    enter,
    enter_own_place,
    follow,
    forget,
    odds_at,
)


def entered(*looks: int) -> int:
    maps = empty_maps(1)
    for seen in looks:
        enter(maps, 0, 3, -2, seen)
    return odds_at(maps, 0, 3.5 * CELL_M, -1.5 * CELL_M)


def test_odds_by_hand():
    assert entered(UNREAD) == 0
    assert entered(WET) == WATER == 8
    assert entered(LAND) == entered(NEAR) == -1
    assert entered(WET, *[LAND] * 8) == 0
    assert entered(WET, *[LAND] * 9) == -1


def test_odds_have_bounds():
    assert entered(*[WET] * 9) == MOST
    assert entered(*[LAND] * 99) == LEAST
    assert entered(*[NEAR] * 99) == GUESS > LEAST
    assert entered(*[LAND] * 3, NEAR) == -3
    assert entered(*[LAND] * 99, WET) == LEAST + WATER > 0


def test_what_is_raised_takes_land_back_but_not_water():
    assert entered(LAND, LAND, VEIL) == 0
    assert entered(WET, VEIL) == WATER


def test_behind_a_veil_only_land_beyond_water_counts():
    assert entered(VEIL, NEAR) == 0
    assert entered(VEIL, LAND) == -1


def test_a_point_outside_the_window_is_unknown():
    maps = empty_maps(1)
    enter(maps, 0, SIZE // 2 - 1, 0, WET)
    edge = SIZE // 2 * CELL_M
    assert odds_at(maps, 0, edge - 0.01, 0.0) == WATER
    # The cell on the other side of the window has the same place in the array.
    assert odds_at(maps, 0, edge - 0.01 - SIZE * CELL_M, 0.0) == 0


def test_the_window_follows_as_a_dictionary_would():
    rng = np.random.default_rng(0)
    maps, known = empty_maps(2), {}
    at = np.zeros(2)
    for _ in range(300):
        at += rng.normal(scale=1.5, size=2)
        follow(maps, 1, at[0], at[1])
        middle = [int(np.floor(metres / CELL_M)) for metres in at]
        for i, j in middle + rng.integers(-SIZE // 2, SIZE // 2, (40, 2)):
            enter(maps, 1, i, j, WET)
            known[i, j] = min(known.get((i, j), 0) + WATER, MOST)
        known = {
            cell: odds
            for cell, odds in known.items()
            if all(-SIZE // 2 <= cell[axis] - middle[axis] < SIZE // 2 for axis in (0, 1))
        }
    assert len(known) > 1000
    found = {cell: odds_at(maps, 1, (cell[0] + 0.5) * CELL_M, (cell[1] + 0.5) * CELL_M) for cell in known}
    assert found == known
    assert int(maps.odds[1].astype(int).sum()) == sum(known.values())
    assert not maps.odds[0].any()


def test_a_far_move_forgets_all_and_so_does_a_start():
    maps = empty_maps(1)
    enter_own_place(maps, 0, 0.1, 0.1)
    assert maps.odds.sum() == WATER
    follow(maps, 0, 1000.0, 0.0)
    assert not maps.odds.any() and maps.corner[0, 0] == cell_of(1000.0) - SIZE // 2
    enter_own_place(maps, 0, 1000.0, 0.0)
    enter(maps, 0, 4000, 0, VEIL)
    forget(maps, 0)
    assert not maps.odds.any() and not maps.veiled.any() and (maps.corner == -SIZE // 2).all()
