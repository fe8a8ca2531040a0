"""Frames for the encoder: real sample_views of the level's rivers, the same for the same seed, whatever the count."""

import numpy as np
import pytest

from thalweg.encoder import EncoderInputError
from thalweg.render import Camera, Randomisation, Renderer
from thalweg.train.encoder.frames import collect_frames, drawn_looks, level_worlds, render_frames, sample_views
from thalweg.world import Reach, WorldError

SMALL = Camera(height_px=64, width_px=64)


@pytest.fixture(scope="module")
def frames() -> np.ndarray:
    return collect_frames(20, "Easy", seed=1, camera=SMALL, progress=False)


def test_they_are_frames_of_water_and_land(frames):
    assert frames.shape == (20, 64, 64, 4) and frames.dtype == np.uint8
    assert set(np.unique(frames[..., 3])) == {0, 255}
    assert 0.02 < (frames[..., 3] > 0).mean() < 0.98
    assert frames[..., :3].std() > 10
    assert len(np.unique(frames.reshape(20, -1), axis=0)) == 20


def test_a_longer_collection_starts_with_the_shorter(frames):
    assert np.array_equal(collect_frames(7, "Easy", seed=1, camera=SMALL, progress=False), frames[:7])


def test_another_seed_gives_other_views(frames):
    other = collect_frames(3, "Easy", seed=2, camera=SMALL, progress=False)
    assert all(not np.array_equal(other[index], frames[index]) for index in range(3))


def test_a_frame_is_what_the_renderer_draws_there(frames):
    worlds = level_worlds("easy", 1)
    poses, index, clock = sample_views(worlds, 20, 1)
    assert np.array_equal(Renderer(worlds, SMALL).render(poses[5:6], index[5:6], clock[5:6])[0], frames[5])


def test_frames_under_varied_looks_have_a_look_and_a_sun_each():
    ranges, views = Randomisation(suns=2), {"camera": SMALL, "quality": "fast", "progress": False}
    frames = collect_frames(6, "Easy", seed=1, randomisation=ranges, **views)
    (world,) = level_worlds("Easy", 1)
    poses, _, clock = sample_views([world], 6, 1)
    looks, suns = drawn_looks(6, 1, ranges)
    assert looks is not None and set(suns) == {0, 1} and len(np.unique(looks, axis=0)) == 6
    for frame, sun in enumerate(suns):
        alone = Renderer([world.relit(*ranges.lights(world.seed)[sun])], SMALL, "fast")
        one = slice(frame, frame + 1)
        np.testing.assert_array_equal(frames[one], alone.render(poses[one], None, clock[one], look=looks[one]))
    shorter = collect_frames(2, "Easy", seed=1, randomisation=ranges, **views)
    np.testing.assert_array_equal(shorter, frames[:2])


@pytest.mark.slow
def test_rivers_take_turns():
    worlds = level_worlds("Easy", 2)
    assert worlds[0].seed != worlds[1].seed
    poses, index, clock = sample_views(worlds, 6, 1)
    assert index.tolist() == [0, 1, 0, 1, 0, 1]
    renderer = Renderer(worlds[1:], SMALL)
    alone = render_frames(renderer, poses[1::2], np.zeros(3, int), clock[1::2], progress=False)
    assert np.array_equal(collect_frames(6, "Easy", seed=1, rivers=2, camera=SMALL, progress=False)[1::2], alone)


@pytest.mark.slow
def test_many_rivers_are_drawn_a_few_at_a_time(monkeypatch: pytest.MonkeyPatch):
    seeds = {"world_seeds": "1:4", "camera": SMALL, "progress": False}
    together = collect_frames(8, "Easy", seed=1, **seeds)
    assert np.array_equal(together, collect_frames(8, "Easy", seed=1, rivers=3, camera=SMALL, progress=False))
    monkeypatch.setattr("thalweg.train.encoder.frames.TOGETHER", 2)
    assert np.array_equal(collect_frames(8, "Easy", seed=1, **seeds), together)


def test_bad_requests_are_named():
    with pytest.raises(EncoderInputError, match="world_seeds: 9:3 holds no seed; write 3:9"):
        collect_frames(3, world_seeds="9:3", progress=False)
    with pytest.raises(WorldError, match="unknown level 'Sea'; known: Easy, Medium, Hard"):
        collect_frames(3, "Sea", progress=False)
    with pytest.raises(EncoderInputError, match="2 images of 3 rivers"):
        collect_frames(2, rivers=3, progress=False)
    with pytest.raises(EncoderInputError, match="0 images of 1 rivers"):
        collect_frames(0, progress=False)


def test_frames_of_a_real_river_are_those_of_its_world(tmp_path):
    path = tmp_path / "brook.geojson"
    path.write_text('{"type": "LineString", "coordinates": [[9, 48], [9.0004, 48], [9.0008, 48], [9.0012, 48]]}')
    reach = Reach(path, width_m=9.0)
    frames = collect_frames(3, reach, seed=1, camera=SMALL, progress=False)
    poses, index, clock = sample_views([reach.build()], 3, 1)
    assert np.array_equal(frames, render_frames(Renderer([reach.build()], SMALL), poses, index, clock, progress=False))
