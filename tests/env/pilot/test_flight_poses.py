"""Flights of the pilot as a source of frames: they move as the rules allow, over the river, the same each time."""

import numpy as np
from PIL import Image

from thalweg.bench.pictures.frame_files import write_frames
from thalweg.env.pilot.flight_poses import FLIGHT_STEPS, pilot_poses


def test_a_flight_moves_a_step_at_a_time_over_the_river(easy_world):
    poses = pilot_poses(easy_world, 3 * FLIGHT_STEPS - 10, 4)
    assert poses.shape == (3 * FLIGHT_STEPS - 10, 4)
    np.testing.assert_array_equal(poses, pilot_poses(easy_world, 3 * FLIGHT_STEPS - 10, 4))
    assert not np.array_equal(poses, pilot_poses(easy_world, 3 * FLIGHT_STEPS - 10, 5))
    moved = np.linalg.norm(np.diff(poses[:FLIGHT_STEPS, :3], axis=0), axis=1)
    assert moved.max() <= np.sqrt(1 + 1 + 0.25) + 1e-9  # up, forward and to the side
    assert moved.sum() > 25
    apart = np.linalg.norm(poses[:, None, :2] - easy_world.river.position_m[None], axis=2)
    assert (apart.min(axis=1) < easy_world.river.width_m[apart.argmin(axis=1)] / 2).all()
    assert np.linalg.norm(poses[FLIGHT_STEPS, :2] - poses[0, :2]) > 1


def test_frames_are_written_one_by_one(tmp_path):
    frames = np.random.default_rng(0).integers(0, 256, (2, 16, 24, 4), dtype=np.uint8)
    write_frames(tmp_path / "frames", frames)
    names = sorted(path.name for path in (tmp_path / "frames").iterdir())
    assert names == ["0000-mask.png", "0000.png", "0001-mask.png", "0001.png"]
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "frames" / "0001.png")), frames[1, ..., :3])
