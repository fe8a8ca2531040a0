"""Tests of the GPU renderer that need no GPU: refused devices, the memory of a pass, and what is replayed."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
import torch

from tests.render.plain import plane
from thalweg.core.compute import gpu, launch_graphs
from thalweg.core.compute.device import DeviceError
from thalweg.render import Camera, Renderer
from thalweg.render.bake.scene_tables import build_scene
from thalweg.render.errors import RenderError
from thalweg.render.gpu import gpu_renderer, pixel, posed_props
from thalweg.render.gpu.gpu_renderer import GpuRenderer
from thalweg.render.kernels.terrain.azimuth_planes import most_planes
from thalweg.render.records.appearance import look_rows, look_values
from thalweg.render.records.props import PropKind
from thalweg.render.records.view import COLOURS, FrameSettings, Views


def test_a_renderer_refuses_a_device_before_it_builds_anything():
    with pytest.raises(DeviceError, match="device = 'gpu'"):
        Renderer([plane()], device="gpu")


def test_a_pass_has_as_many_cameras_as_fit_and_one_at_least():
    assert gpu_renderer.cameras_of_a_pass(6_000, 100) == 60
    assert gpu_renderer.cameras_of_a_pass(10**12, 100) == gpu_renderer.MOST_CAMERAS
    assert gpu_renderer.cameras_of_a_pass(50, 100) == 1


def test_the_error_for_too_many_worlds_states_how_many_fit():
    scene = build_scene([plane()] * 8)
    tables, each = gpu_renderer.bytes_of(scene), 1_500_000
    gpu_renderer.check_memory(scene, each, tables + each)
    with pytest.raises(
        RenderError, match=r"tables of 8 worlds take .* and a camera 1\.5 MB .*: 7 worlds of this size fit"
    ):
        gpu_renderer.check_memory(scene, each, tables + each - 1)
    with pytest.raises(RenderError, match=r"0\.00 GB are free: 0 worlds of this size fit"):
        gpu_renderer.check_memory(scene, each, 100)


def test_scratch_counts_pixels_plants_and_in_full_quality_the_softened_light():
    scene = build_scene([plane()])
    plants = gpu_renderer.most_plants(scene)
    fast, full = (gpu_renderer.bytes_each(plants, 10, 20, fast) for fast in (True, False))
    assert full - fast == 10 * 20 * 12
    assert gpu_renderer.bytes_of(scene) > scene.top.nbytes + scene.atlas.nbytes
    wide = gpu_renderer.bytes_each(plants, 10, 40, True)
    # Twenty columns more take their planes, and the nearness of the vertical planes that serve them.
    assert wide - fast == 10 * 20 * 25 + 10 * (most_planes(40) - most_planes(20)) * 4
    assert most_planes(20) == 48 + 17


class Card:
    """Tensors of the host in place of a GPU's; notes the x of each view at the launches of a frame and at replays."""

    def __init__(self) -> None:
        self.done: list[tuple[str, list[float]]] = []
        self.recording = False
        self._views: Views | None = None

    def launch(
        self, function: Callable, blocks: Any, threads: int, device: Any, *arguments: Any, **options: Any
    ) -> None:
        if isinstance(arguments[0], Views):  # the first kernel of a pass
            self._views = arguments[0]
            self._note("launch")

    def record(self, launches: Callable[[], None], device: str) -> Callable[[], None]:
        launches()
        self.done.pop()
        recorded = self._views
        self._note("record")

        def replay() -> None:
            self._views = recorded
            self._note("replay")

        return replay

    def _note(self, what: str) -> None:
        assert self._views is not None
        self.done.append((what, self._views.poses[:, 0].tolist()))


@pytest.fixture
def card(monkeypatch: pytest.MonkeyPatch) -> Iterator[Card]:
    card = Card()
    monkeypatch.setattr(gpu, "launch", card.launch)
    monkeypatch.setattr(gpu, "to_device", lambda array, device: np.array(array))
    monkeypatch.setattr(gpu, "empty", lambda shape, kind, device: np.empty(shape, kind))
    monkeypatch.setattr(gpu, "free_bytes", lambda device: 10**9)
    monkeypatch.setattr(
        gpu, "as_kernel_array", lambda tensor, kind=None: tensor.numpy() if kind is None else tensor.numpy().view(kind)
    )
    monkeypatch.setattr(launch_graphs, "record_launches", card.record)
    monkeypatch.setattr(launch_graphs, "caller_records", lambda device: card.recording)
    yield card


@pytest.fixture
def renderer(card: Card) -> GpuRenderer:
    return GpuRenderer(build_scene([plane()]), FrameSettings(8, 8, np.float32(0.1), True), "card")


def views_at(x: list[float]) -> tuple[torch.Tensor, ...]:
    """Views of the plane from these places."""
    poses = torch.zeros(len(x), 4, dtype=torch.float64)
    poses[:, 0] = torch.tensor(x)
    rows = torch.from_numpy(np.repeat(look_rows(look_values(None, 1), Camera()), len(x), 0))
    return torch.zeros(len(x), dtype=torch.int64), poses, torch.zeros(len(x), dtype=torch.float64), rows


def test_a_replay_draws_the_views_that_are_given(card: Card, renderer: GpuRenderer):
    out = torch.zeros(2, 8, 8, 4, dtype=torch.uint8)
    for step in range(4):
        renderer.draw_tensors(views_at([step, step + 0.5]), out)
    assert card.done == [("launch", [0, 0.5]), ("record", [1, 1.5]), ("replay", [2, 2.5]), ("replay", [3, 3.5])]


def test_nothing_recorded_is_replayed_after_a_larger_batch_has_moved_the_memory(card: Card, renderer: GpuRenderer):
    small, large = (torch.zeros(count, 8, 8, 4, dtype=torch.uint8) for count in (1, 3))
    for out in (small, small, small, large, small, small):
        renderer.draw_tensors(views_at([7.0] * len(out)), out)
    assert [what for what, _ in card.done] == ["launch", "record", "replay", "launch", "launch", "record"]


def test_nothing_recorded_is_replayed_after_only_the_views_have_moved(card: Card, renderer: GpuRenderer):
    renderer.cameras = 1  # of a pass, so that no batch needs more scratch
    small, large = (torch.zeros(count, 8, 8, 4, dtype=torch.uint8) for count in (1, 2))
    for out in (small, small, large, small):
        renderer.draw_tensors(views_at([7.0] * len(out)), out)
    assert [what for what, _ in card.done] == ["launch", "record", "launch", "launch", "launch"]


def test_scratch_that_grows_for_the_host_forgets_what_was_recorded(card: Card, renderer: GpuRenderer):
    out = torch.zeros(1, 8, 8, 4, dtype=torch.uint8)
    for _ in range(2):
        renderer.draw_tensors(views_at([7.0]), out)
    renderer.draw(Views(*(tensor.numpy() for tensor in views_at([1.0, 2.0]))), np.zeros((2, 8, 8), np.uint32))
    renderer.draw_tensors(views_at([7.0]), out)
    assert [what for what, _ in card.done] == ["launch", "record", "launch", "launch"]


def test_a_graph_of_the_caller_reads_the_views_of_the_caller(card: Card, renderer: GpuRenderer):
    out, views = torch.zeros(1, 8, 8, 4, dtype=torch.uint8), views_at([7.0])
    renderer.draw_tensors(views, out)
    card.recording = True
    renderer.draw_tensors(views, out)
    views[1][0, 0] = 9.0
    assert card._views is not None and card._views.poses[0, 0] == 9.0


def test_views_of_an_inference_mode_can_be_followed_by_others(card: Card, renderer: GpuRenderer):
    out = torch.zeros(1, 8, 8, 4, dtype=torch.uint8)
    with torch.inference_mode():
        renderer.draw_tensors(views_at([1.0]), out)
    renderer.draw_tensors(views_at([2.0]), out)
    assert card.done[-1] == ("record", [2.0])


def test_a_series_of_launches_has_its_own_layers(card: Card, renderer: GpuRenderer):
    out = torch.zeros(1, 8, 8, 4, dtype=torch.uint8)
    layers = [(torch.zeros(1, 8, 8), torch.zeros(1, 8, 8, dtype=torch.uint8)) for _ in range(2)]
    for which in (0, 0, 1, 0):
        renderer.draw_tensors(views_at([7.0]), out, layers[which])
    renderer.draw_tensors(views_at([7.0]), out)
    assert [what for what, _ in card.done] == ["launch", "record", "launch", "replay", "launch"]


def test_a_replay_draws_the_props_that_are_given(card: Card, renderer: GpuRenderer):
    out = torch.zeros(1, 8, 8, 4, dtype=torch.uint8)
    for x in (1.0, 2.0, 3.0):
        renderer.draw_tensors(views_at([7.0]), out, props=torch.tensor([[[PropKind.BUOY, x, 0.0, 0.0, 0.0, 0.0]]]))
    assert [what for what, _ in card.done] == ["launch", "record", "replay"]
    assert renderer._inputs[-1][0, 0, 1] == 3.0


def test_another_number_of_props_replays_nothing(card: Card, renderer: GpuRenderer):
    out = torch.zeros(1, 8, 8, 4, dtype=torch.uint8)
    for count in (2, 2, None, 0, 3, 3):
        props = None if count is None else torch.zeros(1, count, 6)
        renderer.draw_tensors(views_at([7.0]), out, props=props)
    assert [what for what, _ in card.done] == ["launch", "record", "launch", "record", "launch", "record"]


def test_frames_with_props_are_drawn_by_kernels_that_know_them(monkeypatch: pytest.MonkeyPatch, card: Card, renderer):
    launched: list[Any] = []
    monkeypatch.setattr(gpu, "launch", lambda function, *rest: launched.append(function))
    views = Views(*(tensor.numpy() for tensor in views_at([1.0])))
    for props in (None, np.zeros((1, 3, 6), np.float32)):
        renderer.draw(views, np.zeros((1, 8, 8), np.uint32), props=props)
    without, with_props = pixel.tracer(True, COLOURS, False), pixel.tracer(True, COLOURS, True)
    assert [each for each in launched if each in (posed_props.pose, without, with_props)] == [
        without, posed_props.pose, with_props,
    ]  # fmt: skip
