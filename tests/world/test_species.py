"""Tests of the kinds of plants, as the world and the renderer read them."""

import numpy as np
import pytest

from thalweg.world.species import GROUPS, KINDS, kinds_of


def test_names_and_seeds_are_unique():
    assert len({kind.name for kind in KINDS}) == len(KINDS)
    assert len({kind.seed for kind in KINDS}) == len(KINDS)


def test_groups_divide_all_kinds():
    assert sorted(index for group in GROUPS for index in kinds_of(group)) == list(range(len(KINDS)))
    assert all(KINDS[index].group == group for group in GROUPS for index in kinds_of(group))


def test_every_tree_species_has_three_variants():
    species = [KINDS[index].species for index in kinds_of("tree")]
    assert {name: species.count(name) for name in species} == {"pine": 3, "fir": 3, "oak": 3, "birch": 3}


def test_unknown_group_names_the_known_ones():
    with pytest.raises(KeyError, match="tree, shrub, reed, rock"):
        kinds_of("moss")


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_crown_radius_is_zero_outside_the_crown_and_reaches_the_half_width(kind):
    share = np.linspace(-0.1, 1.1, 601)
    radius = kind.crown_radius(share)
    outside = (share < kind.clear_trunk) | (share > 1.0)
    assert not radius[outside].any()
    assert radius.max() == pytest.approx(1.0, abs=0.02)


def test_crown_radius_interpolates_the_profile_by_hand():
    pine = KINDS[0]
    height = pine.clear_trunk + (1.0 - pine.clear_trunk) * 0.45  # halfway between the profile's 0.35 and 0.55
    assert pine.crown_radius(height) == pytest.approx((0.92 + 1.0) / 2)
    assert pine.crown_radius([[height]]).shape == (1, 1)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_light_is_not_created(kind):
    """A leaf reflects and lets through less than it receives; sizes are in order."""
    assert all(r > 0 and r + t < 1 for r, t in zip(kind.leaf_reflectance, kind.leaf_transmittance, strict=True))
    assert 0 < kind.height_m[0] < kind.height_m[1]
    assert 0 <= kind.clear_trunk < 1
