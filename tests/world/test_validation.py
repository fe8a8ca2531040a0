"""Tests of each check on a river made for it."""

from dataclasses import replace

import numpy as np
import pytest

from tests.world.lines import circle, figure_eight
from thalweg.world import River, WorldError, geometry
from thalweg.world import validation as checks
from thalweg.world.bridges import Bridge
from thalweg.world.generate.hydrology import make_river
from thalweg.world.generate.plan import fits_channel

NO_ISLANDS, NO_BRIDGES = np.zeros((0, 5)), np.zeros((0, 11))


def straight(width_m: float = 8.0, length_m: float = 52.0) -> River:
    samples = round(length_m / 1.3) + 1
    line = np.stack([np.arange(samples) * 1.3, np.zeros(samples)], axis=1)
    return make_river(line, False, np.full(samples, width_m), np.ones(samples), np.full(samples, 4.0))


def bridge(deck_z: float, width: float = 3.0) -> np.ndarray:
    row = Bridge(26.0, 0.0, np.pi / 2, 12.0, width, 7.0, 4.0, 1.5, deck_z, 0.0, 0.6)
    return np.array([row])


def test_a_valid_river_passes():
    checks.check_world(straight(), NO_ISLANDS, NO_BRIDGES)


def test_a_self_crossing_line_is_refused_with_its_position():
    line = figure_eight(60.0, 250)
    river = make_river(line, True, np.full(250, 3.0), np.ones(250), np.zeros(250))
    with pytest.raises(
        WorldError, match=r"crosses itself at \(-?[01]\.\d, -?[01]\.\d\) m: arc \d+\.\d m and \d+\.\d m"
    ):
        checks.check_river(river)


def test_a_bed_above_the_water_is_refused_with_its_position():
    river = straight()
    river.depth_m[10] = -0.2
    with pytest.raises(WorldError, match=r"depth is -0\.20 m at arc 13\.0 m"):
        checks.check_river(river)


def test_a_value_that_is_not_finite_is_refused_with_its_position():
    river = straight()
    river.level_m[3] = np.nan
    with pytest.raises(WorldError, match=r"level_m is not a finite number at arc 3\.9 m \(sample 3\)"):
        checks.check_river(river)


def test_a_circle_at_the_limit_of_the_bends_passes_and_one_below_fails():
    for radius, good in ((6.6, True), (6.4, False)):
        line = circle(radius, 32)
        river = make_river(line, True, np.full(32, 4.0), np.ones(32), np.zeros(32))
        if good:
            checks.check_bends(river)
        else:
            with pytest.raises(WorldError, match=r"radius of 6\.40 m"):
                checks.check_bends(river)


def test_an_island_that_blocks_the_river_is_refused_with_its_position():
    island = np.array([[26.0, 0.0, 5.0, 2.5, 0.0]])
    with pytest.raises(WorldError, match=r"no safe pose at arc 2\d\.\d m: nowhere 1\.00 m from banks and islands"):
        checks.check_world(straight(), island, NO_BRIDGES)


def test_the_widest_gap_beside_an_island_keeps_the_clearance():
    island = np.array([[26.0, -1.5, 5.0, 1.0, 0.0]])
    gaps = checks.widest_free_gaps(straight(), island, 1.0)
    np.testing.assert_allclose(gaps[0], [-3.0, 3.0])
    np.testing.assert_allclose(gaps[20], [0.5, 3.0], atol=0.04)


def test_heights_over_a_bridge_clear_its_hull_by_half_a_body():
    heights = checks.safe_heights(straight(), bridge(6.2))
    np.testing.assert_allclose(heights[20], [6.2 + 0.6 + 0.25 - 4.0, 15.0])
    np.testing.assert_allclose(heights[10], [0.5, 15.0])


def test_a_bridge_as_high_as_the_ceiling_is_refused_with_its_position():
    with pytest.raises(WorldError, match=r"a bridge reaches 14\.85 m over the water; limit 14\.00 m"):
        checks.check_world(straight(), NO_ISLANDS, bridge(18.0))


@pytest.mark.parametrize(
    ("row", "fits"), [((26, 1.8, 4, 1.2, 0), True), ((26, 2.6, 4, 1.2, 0), False), ((26, 0, 4, 2.8, 0), False)]
)
def test_an_island_must_keep_off_the_bank_and_leave_an_arm(row, fits):
    assert fits_channel(np.array(row, dtype=np.float64), straight()) == fits


def test_arms_are_checked_with_the_required_land():
    line = circle(12.0, 58)
    river = make_river(line[:-6], False, np.full(52, 4.0), np.ones(52), np.zeros(52))
    gap = float(np.hypot(*(line[0] - line[51])))
    checks.check_arms(river, gap - 4.0 - 0.1)
    with pytest.raises(WorldError, match=r"banks of two arms overlap: arc 0\.0 m and 66\.\d m"):
        checks.check_arms(replace(river), gap - 4.0 + 0.1)


@pytest.mark.parametrize("seed", range(6))
def test_the_arms_that_are_named_are_the_nearest_of_all_pairs(seed: int):
    """Wiggling rivers of various widths, on whole metres in part, so that distances are equal: the first is named."""
    random = np.random.default_rng(seed)
    angle = np.linspace(0.0, 5.9, 240)
    radius = 40.0 + (np.round(10 * np.sin(3 * angle)) if seed % 2 else random.normal(size=240).cumsum())
    line = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    width = random.uniform(4.0, 30.0, 240) if seed % 3 else np.full(240, 20.0)
    river = make_river(line, False, width, np.ones(240), np.zeros(240))
    needed = (width[:, None] + width[None, :]) / 2 + 5.0
    apart = np.hypot(*(line[:, None] - line[None, :]).transpose(2, 0, 1))
    other_arm = np.abs(river.arc_m[:, None] - river.arc_m[None, :]) > 1.6 * needed
    margin = np.where(other_arm, apart - needed, np.inf)
    i, j = np.unravel_index(int(np.argmin(margin)), margin.shape)
    assert margin[i, j] < 0 and i < j
    with pytest.raises(WorldError) as caught:
        checks.check_arms(river, 5.0)
    named = f"arc {river.arc_m[i]:.1f} m and {river.arc_m[j]:.1f} m are {apart[i, j]:.2f} m apart"
    assert named in str(caught.value) and str(caught.value).endswith(f"limit {needed[i, j]:.2f} m")


def test_arms_are_compared_in_blocks_with_the_same_result(monkeypatch):
    line = circle(12.0, 58)
    river = make_river(line[:-6], False, np.full(52, 4.0), np.ones(52), np.zeros(52))
    messages = []
    for pairs in (10**6, 200):
        monkeypatch.setattr(geometry, "BLOCK_PAIRS", pairs)
        with pytest.raises(WorldError) as caught:
            checks.check_arms(river, 6.0)
        messages.append(str(caught.value))
    assert messages[0] == messages[1]
