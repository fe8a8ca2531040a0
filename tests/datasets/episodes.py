"""Small recorded flights without a river, whose numbers all differ."""

from dataclasses import replace

import numpy as np

from thalweg.datasets.episode import About, RecordedEpisode

SIZE = (32, 34)
ABOUT = About(
    fps=4,
    camera={"height_px": 32, "width_px": 34, "fov_deg": 60.0},
    proprioception=("height", "climb rate"),
    cost_kinds=("tight", "loose"),
    reasons=("Collision", "Success"),
    classes=("sky", "water", "ground"),
    versions={"RENDER": 3},
)


def flight(steps: int, seed: int = 0, *, discrete: bool = True, ended: bool = True) -> RecordedEpisode:
    """A flight of random numbers."""
    rng = np.random.default_rng(seed)
    options = rng.integers(3, size=(steps, 4))
    return RecordedEpisode(
        rgb=rng.integers(256, size=(steps + 1, *SIZE, 3), dtype=np.uint8),
        mask=rng.integers(2, size=(steps + 1, *SIZE), dtype=np.uint8) * 255,
        depth_m=rng.uniform(-1, 300, (steps + 1, *SIZE)).astype(np.float32),
        class_id=rng.integers(3, size=(steps + 1, *SIZE), dtype=np.uint8),
        proprioception=rng.normal(size=(steps + 1, 2)).astype(np.float32),
        poses=rng.normal(size=(steps + 1, 4)),
        times_s=rng.uniform(0, 600, steps + 1),
        moves=(1 - options).astype(np.float32),
        options=options if discrete else None,
        rewards=rng.uniform(size=steps).astype(np.float32).astype(np.float64),
        costs=rng.uniform(size=(steps, 2)).astype(np.float32).astype(np.float64),
        terminated=ended,
        reason=1 if ended else -1,
        pilots=("hand",) * (steps - 1) + ("pilot",),
        task="River",
        options_of_flight={"level": "Easy", "seed": 7 + seed, "world_seed": None},
    )


def assert_same(found: RecordedEpisode, wanted: RecordedEpisode, *, frames: int | None = None) -> None:
    """Assert that two flights are equal; of what is seen, the first `frames`."""
    seen = ("rgb", "mask", "depth_m", "class_id")
    for name in (*seen, "proprioception", "poses", "times_s", "moves", "options", "rewards", "costs"):
        one, other = getattr(found, name), getattr(wanted, name)
        rows = slice(frames if name in seen else None)
        assert (one is None) == (other is None), name
        if one is not None:
            np.testing.assert_array_equal(one[rows], other[rows], err_msg=name)
    plain = ("terminated", "reason", "pilots", "task", "options_of_flight")
    assert {name: getattr(found, name) for name in plain} == {name: getattr(wanted, name) for name in plain}


def without(episode: RecordedEpisode, **layers: None) -> RecordedEpisode:
    """The flight without some layers."""
    return replace(episode, **layers)
