"""Tests of the gallery: a strip for each range, with the frames at its ends."""

import numpy as np

from tests.render.plain import plane, plants_at
from thalweg.bench.pictures.gallery import GAP_PX, TITLE_PX, gallery, strip
from thalweg.render import Camera, Look, Randomisation, Renderer
from thalweg.render.records.appearance import PARAMETERS

SIZE = 24


def test_each_strip_shows_both_ends_of_its_range_and_the_default():
    camera = Camera(SIZE, SIZE)
    world = plane(slope_x=-0.05, water_level=0.0, plants=plants_at([(4.0, 1.0)], 9))
    pose = np.array([-12.0, 0.0, 4.0, 0.0])
    ranges = Randomisation(haze=(0.0, 30.0), season=(0.0, 0.9))
    page = np.asarray(gallery(world, pose, camera, ranges))
    wide, high = 3 * SIZE + 2 * GAP_PX, TITLE_PX + SIZE
    renderer = Renderer([world], camera)
    for name in ("haze", "season"):
        index = PARAMETERS.index(name)
        left, top = index % 2 * (wide + 4 * GAP_PX), index // 2 * (high + 2 * GAP_PX) + TITLE_PX
        ends = getattr(ranges, name)
        usual = getattr(Look(), name)
        middle = usual if ends[0] < usual < ends[1] else sum(ends) / 2  # the default is not shown twice
        looks = [Look(**{name: value}) for value in (ends[0], middle, ends[1])]
        for k, frame in enumerate(renderer.render(np.tile(pose, (3, 1)), look=looks)):
            at = left + k * (SIZE + GAP_PX)
            np.testing.assert_array_equal(page[top : top + SIZE, at : at + SIZE], frame[..., :3])
    strips = len(PARAMETERS) + 2
    assert page.shape == (-(-strips // 2) * (high + 2 * GAP_PX) - 2 * GAP_PX, 2 * wide + 4 * GAP_PX, 3)


def test_a_strip_has_its_frames_side_by_side_under_a_title():
    frames = np.arange(2 * 8 * 8 * 3, dtype=np.uint8).reshape(2, 8, 8, 3)
    picture = np.asarray(strip("a title", frames))
    np.testing.assert_array_equal(picture[TITLE_PX:, :8], frames[0])
    np.testing.assert_array_equal(picture[TITLE_PX:, 8 + GAP_PX :], frames[1])
    assert picture[:TITLE_PX].min() < 128
