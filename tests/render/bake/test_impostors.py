"""The atlas of plants: its layout, its light, its coverage from level to level, and its place on the disk."""

import math

import numpy as np
import pytest

from thalweg.render.bake import impostors
from thalweg.render.bake.impostors import COLS, LEVELS, ROWS, VIEWS, Atlas, cols, keep_coverage, rows
from thalweg.world.species import KINDS, kinds_of

ELEVATION = math.radians(40)
ALL = range(len(KINDS))
TREES = kinds_of("tree")


@pytest.fixture(scope="module")
def atlas() -> Atlas:
    return impostors.build(ELEVATION)


def cover(atlas: Atlas, kind: int, view: int, level: int = 0) -> np.ndarray:
    return atlas.picture(kind, view, level)[..., 3] / 255.0


def linear(picture: np.ndarray) -> np.ndarray:
    return (picture[..., :3] / 255.0) ** 2


def touching(mask: np.ndarray) -> np.ndarray:
    """Texels beside one of the mask [rows, columns]."""
    near = np.zeros_like(mask)
    near[1:-1, 1:-1] = mask[2:, 1:-1] | mask[:-2, 1:-1] | mask[1:-1, 2:] | mask[1:-1, :-2]
    return near


def mean_light(picture: np.ndarray) -> float:
    """Mean radiance of a picture, weighted by coverage."""
    weight = picture[..., 3:] / 255.0
    return float((linear(picture) * weight).sum() / (3 * weight.sum()))


@pytest.mark.slow
def test_same_bytes_every_time(atlas):
    again = impostors.build(ELEVATION)
    assert again.texels.tobytes() == atlas.texels.tobytes()
    assert again.shade.tobytes() == atlas.shade.tobytes()


def test_layout_is_the_documented_one_and_fits_the_memory(atlas):
    pictures = len(KINDS) * VIEWS
    assert (rows(0), cols(0), rows(LEVELS - 1), cols(LEVELS - 1)) == (256, 128, 4, 2)
    assert [int(o) for o in atlas.offset[:3]] == [0, pictures * 256 * 128, pictures * (256 * 128 + 128 * 64)]
    assert len(atlas.texels) == atlas.offset[-1] + pictures * 4 * 2
    assert atlas.texels.nbytes < 30e6
    kind, view, level, row, col = 7, 3, 2, 20, 9
    texel = atlas.offset[level] + ((kind * VIEWS + view) * rows(level) + row) * cols(level) + col
    assert np.array_equal(atlas.texels[texel], atlas.picture(kind, view, level)[row, col])
    value = int(atlas.packed[texel])
    assert [value >> shift & 255 for shift in (0, 8, 16, 24)] == atlas.texels[texel].tolist()


@pytest.mark.parametrize("kind", ALL, ids=lambda kind: KINDS[kind].name)
def test_plant_stands_on_the_lowest_row_and_reaches_the_top(atlas, kind):
    for view in range(VIEWS):
        picture = cover(atlas, kind, view)
        assert picture[0].max() > 0.5
        assert picture.mean() > 0.2
    assert max(cover(atlas, kind, view)[-6:].max() for view in range(VIEWS)) > 0.25


@pytest.mark.parametrize("kind", ALL, ids=lambda kind: KINDS[kind].name)
def test_silhouette_follows_the_crown_outline(atlas, kind):
    """The world casts shadows from the outline; nearly everything drawn in the crown lies inside it, and fills it."""
    picture = np.mean([cover(atlas, kind, view) for view in range(VIEWS)], 0)
    height = (np.arange(ROWS) + 0.5) / ROWS
    outline = KINDS[kind].crown_radius(height)
    inside = np.abs((np.arange(COLS) + 0.5) / (COLS / 2) - 1) <= outline[:, None]
    crown = (height > KINDS[kind].clear_trunk)[:, None]
    assert (picture * ~inside * crown).sum() < 0.09 * picture.sum()
    assert picture[inside].mean() > 0.55


@pytest.mark.parametrize("kind", [k for k in ALL if KINDS[k].group != "rock"], ids=lambda kind: KINDS[kind].name)
def test_density_lets_through_what_the_grown_crown_lets_through(atlas, kind):
    """Extinction over the mean chord of the crown, pi/2 times its mean radius, against the holes in the pictures."""
    model = KINDS[kind]
    height = (np.arange(ROWS) + 0.5) / ROWS
    outline = model.crown_radius(height)
    inside = np.abs((np.arange(COLS) + 0.5) / (COLS / 2) - 1) <= outline[:, None]
    covered = np.mean([cover(atlas, kind, view)[inside].mean() for view in range(VIEWS)])
    radius_m = outline[outline > 0].mean() * np.mean(model.height_m) * model.aspect / 2
    assert 1 - math.exp(-model.density_per_m * math.pi / 2 * radius_m) == pytest.approx(covered, abs=0.08)


def test_front_lit_trees_are_brighter_than_back_lit_ones(atlas):
    for kind in TREES:
        front, back = mean_light(atlas.picture(kind, VIEWS // 2)), mean_light(atlas.picture(kind, 0))
        assert front > 1.6 * back


def test_view_from_one_side_of_the_sun_is_lit_from_that_side(atlas):
    """View 2 looks 90 degrees to the left of the sun, so the sun stands on its right; view 6 has it on its left."""
    for kind in kinds_of("rock"):
        for view, bright in ((2, slice(COLS // 2, None)), (6, slice(0, COLS // 2))):
            picture = atlas.picture(kind, view)
            dark = slice(0, COLS // 2) if bright.start else slice(COLS // 2, None)
            assert mean_light(picture[:, bright]) > 1.3 * mean_light(picture[:, dark])


def test_tops_of_trees_are_lighter_than_the_foot_of_their_crowns(atlas):
    for kind in TREES:
        crown = int(KINDS[kind].clear_trunk * ROWS)
        third = (ROWS - crown) // 3
        low = np.mean([mean_light(atlas.picture(kind, v)[crown : crown + third]) for v in range(VIEWS)])
        high = np.mean([mean_light(atlas.picture(kind, v)[-third:]) for v in range(VIEWS)])
        assert high > 1.15 * low


def test_leaves_are_green_and_never_brighter_than_a_white_surface(atlas):
    for kind in TREES:
        picture = atlas.picture(kind, VIEWS // 2)
        weight = picture[..., 3:] / 255.0
        red, green, blue = (linear(picture) * weight).sum((0, 1)) / weight.sum()
        assert green > 2 * blue
        assert 0.75 < red / green < 1.1
        assert 0.02 < green < 0.12


def test_shade_is_a_small_bluish_share(atlas):
    assert atlas.shade.shape == (len(KINDS), VIEWS, 3)
    front = atlas.shade[:, VIEWS // 2]
    assert (front > 0.05).all()
    assert (front < 0.5).all()
    assert (front[:, 2] > front[:, 0]).all()


@pytest.mark.parametrize("level", range(2, LEVELS))
def test_foliage_neither_thins_out_nor_fills_up_on_far_levels(atlas, level):
    quantum = 1 / (rows(level) * cols(level))
    for kind in ALL:
        for view in range(VIEWS):
            full, far = cover(atlas, kind, view, 1), cover(atlas, kind, view, level)
            assert (far >= 0.5).mean() == pytest.approx((full >= 0.5).mean(), abs=0.012 + 1.25 * quantum)
        mean = np.mean([cover(atlas, kind, v, 1).mean() for v in range(VIEWS)])
        far_mean = np.mean([cover(atlas, kind, v, level).mean() for v in range(VIEWS)])
        assert far_mean == pytest.approx(mean, abs=0.01 if level < LEVELS - 1 else 0.05)


def test_the_nearest_level_covers_what_the_next_one_does(atlas):
    for kind in ALL:
        for view in range(VIEWS):
            near = cover(atlas, kind, view).reshape(rows(1), 2, cols(1), 2).mean((1, 3))
            assert near == pytest.approx(cover(atlas, kind, view, 1), abs=0.005)


def test_keep_coverage_by_hand():
    """Four texels, a share of 1/2 wanted solid: the second highest becomes the half, order stays."""
    bent = keep_coverage(np.array([0.1, 0.3, 0.4, 0.0]), 0.5, 0.3)
    assert bent[1] == pytest.approx(0.5)
    assert bent[2] > 0.5 > bent[0] > bent[3] == 0.0


def test_detail_by_hand():
    """A block half black, half of radiance 2: mean 1, every texel 1 away from it, so the contrast is 1."""
    level = np.ones((1, 4, 4, 4), np.float32)
    level[0, :2, :, :3], level[0, 2:, :, :3] = 0.0, 2.0
    coarse, fine, contrast = impostors.detail(level)
    assert (coarse == 1.0).all()
    assert (fine[0, :2] == -1.0).all()
    assert contrast == pytest.approx(1.0)


def test_leaves_sparkle_on_far_levels_as_on_the_nearest(atlas):
    pictures = len(KINDS) * VIEWS

    def contrast(level: int) -> float:
        begin, size = int(atlas.offset[level]), pictures * rows(level) * cols(level)
        texels = atlas.texels[begin : begin + size].reshape(pictures, rows(level), cols(level), 4) / 255.0
        texels[..., :3] = texels[..., :3] ** 2 * texels[..., 3:]
        return impostors.detail(texels)[2]

    near = contrast(1)
    assert [contrast(level) for level in (2, 3, 4)] == pytest.approx([near] * 3, rel=0.1)


def test_empty_texels_have_the_colours_of_their_plant(atlas):
    """Filtering at an edge mixes with empty texels: there must be no dark fringe."""
    for kind in ALL:
        picture = atlas.picture(kind, VIEWS // 2)
        filled, empty = picture[..., 3] > 200, picture[..., 3] == 0
        fringe, edge = empty & touching(filled), filled & touching(empty)
        assert fringe.sum() >= 5
        assert linear(picture)[fringe].mean() == pytest.approx(linear(picture)[edge].mean(), rel=0.35)


def test_compositing_over_white_and_black_gives_back_the_colour(atlas):
    picture = atlas.picture(6, 4)
    alpha, colour = picture[..., 3:] / 255.0, linear(picture)
    over_black, over_white = alpha * colour, alpha * colour + (1 - alpha)
    seen = (1 - (over_white - over_black))[..., 0] > 0.02
    back = over_black[seen] / (1 - (over_white - over_black))[seen]
    assert back == pytest.approx(colour[seen])
    assert np.median(colour[seen & (alpha[..., 0] < 0.5)]) > 0.4 * np.median(colour[alpha[..., 0] > 0.9])


def test_view_is_named_by_the_angle_between_look_and_sun():
    assert impostors.view_of(1.0, 1.0) == 0
    assert impostors.view_of(1.0 + math.pi, 1.0) == 4
    assert impostors.view_of(math.pi / 2, 0.0) == 2
    assert impostors.view_of(-math.pi / 2, 0.0) == 6
    assert impostors.view_of(2 * math.pi - 0.1, 0.0) == 0


def test_sun_must_be_up():
    with pytest.raises(ValueError, match="sun_elevation"):
        impostors.atlas(0.0)
    with pytest.raises(ValueError, match="sun_elevation"):
        impostors.atlas(2.0)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("THALWEG_CACHE", str(tmp_path))
    impostors.remembered.cache_clear()
    yield tmp_path
    impostors.remembered.cache_clear()


def test_atlas_is_kept_on_the_disk_and_shared_by_nearly_equal_suns(folder, atlas, monkeypatch):
    builds = []
    monkeypatch.setattr(impostors, "build", lambda elevation: builds.append(elevation) or atlas)
    first = impostors.atlas(ELEVATION)
    assert impostors.atlas(ELEVATION + 0.01) is first
    impostors.remembered.cache_clear()
    assert impostors.atlas(ELEVATION).texels.tobytes() == atlas.texels.tobytes()
    assert builds == [pytest.approx(ELEVATION)]
    assert [file.suffix for file in folder.iterdir()] == [".npz"]


@pytest.mark.parametrize(
    ("changed", "value"),
    [("llvmlite.binding.get_host_cpu_name", lambda: "another"), ("numba.__version__", "0"), ("numpy.__version__", "0")],
    ids=["processor", "Numba", "NumPy"],
)
def test_another_machine_or_version_of_a_library_has_its_own_file(folder, monkeypatch, changed: str, value: object):
    made = Atlas(np.zeros((1, 4), np.uint8), np.zeros(LEVELS, np.int64), np.zeros((1, VIEWS, 3), np.float32))
    monkeypatch.setattr(impostors, "build", lambda elevation: made)
    impostors.atlas(ELEVATION)
    monkeypatch.setattr(changed, value)
    impostors.remembered.cache_clear()
    impostors.atlas(ELEVATION)
    assert len([*folder.iterdir()]) == 2


def test_damaged_file_is_rebuilt(folder, atlas, monkeypatch):
    monkeypatch.setattr(impostors, "build", lambda elevation: atlas)
    impostors.atlas(ELEVATION)
    (file,) = folder.iterdir()
    whole = file.read_bytes()
    for damage in (whole[: len(whole) // 2], b"not an archive", b""):
        file.write_bytes(damage)
        impostors.remembered.cache_clear()
        assert impostors.atlas(ELEVATION).texels.tobytes() == atlas.texels.tobytes()
        impostors.remembered.cache_clear()
        assert impostors.stored(file) is not None


@pytest.mark.parametrize(
    "damage",
    [
        {"offset": np.arange(impostors.LEVELS) * 10**9},
        {"offset": np.zeros(impostors.LEVELS)},
        {"shade": np.full((len(impostors.KINDS), impostors.VIEWS, 3), np.nan, np.float32)},
        {"shade": np.zeros((len(impostors.KINDS), impostors.VIEWS, 3))},
    ],
)
def test_an_atlas_whose_numbers_cannot_be_is_damaged(damage, folder, atlas):
    """Kernels read texels where the levels begin, and do not check that these are there."""
    whole = {"texels": atlas.texels, "offset": atlas.offset, "shade": atlas.shade}
    np.savez(folder / "whole.npz", **whole)
    np.savez(folder / "damaged.npz", **(whole | damage))
    assert impostors.stored(folder / "whole.npz") is not None and impostors.stored(folder / "damaged.npz") is None


def test_shared_atlas_cannot_be_written_to(folder, atlas, monkeypatch):
    monkeypatch.setattr(impostors, "build", lambda elevation: atlas)
    with pytest.raises(ValueError, match="read-only"):
        impostors.atlas(ELEVATION).texels[0] = 0


def test_the_name_of_an_atlas_covers_the_code_that_compiles_and_draws_it():
    parts = ("core/compute/jit.py", "core/compute/kernel_compiler.py", "world/species.py", "render/bake/trees.py")
    assert {impostors.PACKAGE / part for part in parts} <= set(impostors.SOURCES)
