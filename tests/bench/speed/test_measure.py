"""Tests of speed measurements, with a clock that the test moves."""

from pathlib import Path

import numpy as np
import pytest

from thalweg.bench.speed import frame_profile
from thalweg.bench.speed import measure as speed
from thalweg.bench.speed.frame_profile import REFLECTION, STAGES, draw_and_time
from thalweg.bench.speed.measure import Plan, rates
from thalweg.bench.speed.stage_times import EDGES, TIMED_STAGES
from thalweg.encoder import VAE, Encoder, VAEConfig
from thalweg.env import sample_starts
from thalweg.render import Camera, Renderer


class Clock:
    """A clock that work moves: what a test expects of it is exact."""

    def __init__(self, *seconds: float) -> None:
        self.now, self.seconds, self.calls = 100.0, seconds, 0

    def __call__(self) -> float:
        return self.now

    def work(self) -> int:
        """Three units in as many seconds as the clock was given for this call, or for the last."""
        self.now += self.seconds[min(self.calls, len(self.seconds) - 1)]
        self.calls += 1
        return 3


def test_a_rate_is_work_over_elapsed_time():
    clock = Clock(0.25)
    assert rates(clock.work, Plan(repeats=3, seconds=1.0), clock) == [12, 12, 12]
    assert clock.calls == 1 + 3 * 4


def test_a_repetition_counts_the_time_that_it_took():
    clock = Clock(0.25, 0.75, 0.75, 0.5)
    assert rates(clock.work, Plan(repeats=1, seconds=1.0), clock) == [6 / 1.5]


def test_the_first_call_which_may_compile_is_not_counted():
    clock = Clock(60.0, 0.25)
    assert rates(clock.work, Plan(repeats=1, seconds=1.0), clock) == [12]


def test_training_is_measured_by_update_without_its_start(monkeypatch: pytest.MonkeyPatch):
    given: list[str] = []

    def child(command: list[str], **_: str) -> tuple[float, float]:
        given.extend(command)
        folder = Path(command[command.index("--out") + 1])
        folder.mkdir()
        rows = "steps,steps_per_second,seconds\n2048,20,100\n4096,400,105\n6144,200,115\n8192,300,122\n"
        (folder / "metrics.csv").write_text(rows)
        return 130.0, 900.0

    monkeypatch.setattr(speed, "_run_python", child)
    train, start, memory = speed._training(Plan(train_steps=8192))
    assert (train.name, train.median, train.slowest, train.fastest, train.repeats) == ("train", 300, 200, 400, 3)
    assert (train.batch, train.worlds) == (16, 4)
    assert train.features == "FOCOPS on Medium, frames included; 3 updates of 2,048 steps each, after the first"
    assert given[given.index("--world-seeds") + 1 :][:4] == ["0", "1", "2", "3"]
    assert (start.median, start.unit) == (8, "s")
    assert (memory.median, memory.unit) == (900, "MiB")


def test_the_slowest_is_the_lowest_rate_or_the_longest_time():
    rate = speed._measurement("render", "frames/s", [3.0, 1.0, 2.0])
    duration = speed._measurement("build", "s", [3.0, 1.0, 2.0])
    assert (rate.median, rate.slowest, rate.fastest) == (2, 1, 3)
    assert (duration.median, duration.slowest, duration.fastest) == (2, 3, 1)


@pytest.mark.slow
def test_masks_are_measured_with_an_encoder_of_masks():
    def encoder(inputs: str) -> Encoder:
        return Encoder(VAE(VAEConfig(inputs=inputs, latent=6, architecture="paper")))

    own = encoder("mask")
    assert speed._mask_encoder(own) == (own, "mask to 6 numbers, paper architecture")
    untrained, words = speed._mask_encoder(encoder("rgb+mask"))
    assert (untrained.inputs, untrained.latent, untrained.config.architecture) == ("mask", 6, "paper")
    assert words == "mask to 6 numbers, paper architecture, untrained"


@pytest.mark.slow
def test_the_stages_together_draw_the_frame(easy_world):
    """The kernel that times the stages draws what the renderer draws, and its stages are most of a frame."""
    renderer = Renderer([easy_world], Camera(32, 48))
    poses = sample_starts(easy_world, 3, 3)
    images, spent = draw_and_time(renderer, poses)
    frames = renderer.render(poses)
    apart = np.abs(images.view(np.uint8).reshape(frames.shape).astype(int) - frames)
    assert apart.max() <= 1  # kernels compiled into another may round a last bit otherwise
    assert (apart == 0).mean() > 0.999
    assert (np.delete(spent, EDGES, axis=1) > 0).all()  # there is no bridge here whose edges could be softened
    assert (spent[:, :-1].sum(1) <= spent[:, -1]).all() and (spent[:, :-1].sum(1) > 0.5 * spent[:, -1]).all()


@pytest.mark.slow
def test_the_stages_and_the_rest_add_up_to_the_frame_of_the_renderer(easy_world, monkeypatch: pytest.MonkeyPatch):
    clock = {"whole": 0.008, "ours": 0.006}
    spent = np.ones((2, len(TIMED_STAGES) + 1), np.int64)
    spent[:, 2] = 3
    spent[:, -1] = 12  # a tick for each stage, but three for the plants; one belongs to none
    now = iter(np.cumsum([0, clock["whole"], 0, clock["ours"]] * 3))
    monkeypatch.setattr(frame_profile.time, "perf_counter", lambda: next(now))
    monkeypatch.setattr(frame_profile, "draw_and_time", lambda *_: (None, spent))
    monkeypatch.setattr(frame_profile, "_median_ms", lambda *_: 0.5)
    times = frame_profile.profile_frame(easy_world, Camera(16, 16), views=2, repeats=2)
    assert times["plants"] == pytest.approx([6 * 3 / 24] * 2)
    assert times["bridges"] == pytest.approx([6 / 24] * 2)
    total = sum(np.array(times[name]) for name in STAGES if name != REFLECTION)
    assert total == pytest.approx([4.0, 4.0])  # 8 ms for two frames


def test_the_shares_of_the_stages_add_up(monkeypatch: pytest.MonkeyPatch):
    times = {name: [float(place), float(place + 2)] for place, name in enumerate(STAGES)}
    monkeypatch.setattr(speed, "profile_frame", lambda *_, **__: times)
    monkeypatch.setattr(speed, "load_or_build", lambda *_: None)
    lines = list(speed.measure_stages(Plan()))
    assert [(line.name, line.median, line.slowest, line.unit) for line in lines[:2]] == [
        ("ground", 1.0, 2.0, "ms"),
        ("bridges", 2.0, 3.0, "ms"),
    ]
    shares = {line.name: int(line.features.split("%")[0]) for line in lines}
    assert sum(share for name, share in shares.items() if name != REFLECTION) == pytest.approx(100, abs=4)
