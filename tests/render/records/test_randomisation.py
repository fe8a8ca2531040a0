"""Domain randomisation: what is drawn stays within the ranges, covers them, and bad ranges are refused by name."""

import numpy as np
import pytest

from thalweg.core.config import bounds
from thalweg.render import Look, Randomisation
from thalweg.render.records.appearance import LIMITS, PARAMETERS, look_values
from thalweg.render.records.randomisation import MAX_SUNS, SUN_PARAMETERS
from thalweg.world.record import World


def test_draws_fill_their_ranges_evenly_and_depend_on_the_generator_alone():
    ranges = Randomisation()
    generator = np.random.default_rng(4)
    looks, suns = zip(*(ranges.draw(generator) for _ in range(4000)), strict=True)
    low, high = ranges.ends
    share = (np.array(looks) - low) / (high - low)
    assert share.min() >= 0
    assert share.max() <= 1
    np.testing.assert_allclose(share.mean(axis=0), 0.5, atol=0.03)
    np.testing.assert_allclose(share.std(axis=0), np.sqrt(1 / 12), atol=0.02)
    np.testing.assert_allclose(np.bincount(suns) / 4000, 1 / 4, atol=0.04)
    again = np.random.default_rng(4)
    np.testing.assert_array_equal(looks[:3], [ranges.draw(again)[0] for _ in range(3)])
    look_values(np.array(looks), 4000)  # all within the limits of a look


def test_only_what_is_named_varies():
    drawn, sun = Randomisation.only(haze=(2.0, 3.0)).draw(np.random.default_rng(0))
    usual = look_values(Look(), 1)[0]
    varied = PARAMETERS.index("haze")
    assert 2.0 <= drawn[varied] <= 3.0
    np.testing.assert_array_equal(np.delete(drawn, varied), np.delete(usual, varied))
    assert sun == 0
    assert Randomisation.only(haze=(2.0, 3.0)).suns == 0
    assert Randomisation.only(sun_elevation_deg=(30.0, 40.0)).suns == 4
    with pytest.raises(ValueError, match=r"unknown range 'fog'.*; known: .*haze"):
        Randomisation.only(fog=(0.0, 1.0))


def test_suns_lie_in_separate_parts_of_their_ranges_and_differ_between_worlds():
    ranges = Randomisation(sun_azimuth_deg=(0.0, 90.0), sun_elevation_deg=(20.0, 60.0), suns=8)
    azimuth, elevation = np.degrees(ranges.lights(3)).T
    np.testing.assert_array_equal(np.sort(azimuth // (90 / 8)), np.arange(8))
    np.testing.assert_array_equal(np.sort((elevation - 20) // (40 / 8)), np.arange(8))
    assert ranges.lights(3) == ranges.lights(3)
    assert ranges.lights(3) != ranges.lights(4)
    assert Randomisation(suns=0).lights(3) == []


@pytest.mark.parametrize("name", [*LIMITS, *SUN_PARAMETERS])
def test_a_range_that_is_none_is_refused_by_name(name: str):
    low, high = bounds(Randomisation, name)
    for value, fault in (
        ((high, low), "must have its lower end first"),
        ((low - 1.0, high), f"must be a number from {low:g} to {high:g}"),
        ((low, high + 1.0), f"must be a number from {low:g} to {high:g}"),
        (1.0, "must be a pair, each a number from"),
        ((low, "high"), "must be a number from"),
        ((low, float("nan")), "must be a number from .*, got nan"),
    ):
        with pytest.raises(ValueError, match=rf"^{name}(\[[01]\])? {fault}"):
            Randomisation.only(**{name: value})


def test_suns_and_period_are_checked():
    for suns in (-1, 1.5, MAX_SUNS + 1, True):
        with pytest.raises(ValueError, match=f"suns must be a whole number from 0 to {MAX_SUNS}, got {suns}"):
            Randomisation(suns=suns)  # pyright: ignore
    with pytest.raises(ValueError, match="per must be one of 'episode', 'environment', got 'step'"):
        Randomisation(per="step")  # pyright: ignore


@pytest.mark.slow
def test_a_world_under_its_own_sun_is_itself_and_another_sun_moves_only_light(easy_world: World):
    same = easy_world.relit(easy_world.sun_azimuth, easy_world.sun_elevation)
    other = easy_world.relit(easy_world.sun_azimuth + 2.0, np.radians(30.0))
    for name in ("sun", "sky", "canopy_m"):
        np.testing.assert_array_equal(getattr(same, name), getattr(easy_world, name))
    np.testing.assert_array_equal(same.plants.light, easy_world.plants.light)
    for name in ("ground_m", "water_m", "albedo", "sky", "canopy_m"):
        np.testing.assert_array_equal(getattr(other, name), getattr(easy_world, name))
    # A low sun leaves less of the valley lit, and elsewhere.
    assert other.sun.mean() < 0.95 * easy_world.sun.mean()
    assert (np.abs(other.sun.astype(int) - easy_world.sun) > 60).mean() > 0.05
    assert np.abs(other.plants.light - easy_world.plants.light).mean() > 0.02
