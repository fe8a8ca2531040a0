"""Tests of the GPU renderer that need no GPU: refused devices and the memory of a pass."""

import pytest

from tests.render.plain import plane
from thalweg.core.compute.device import DeviceError
from thalweg.render import Renderer
from thalweg.render.bake.scene_tables import build_scene
from thalweg.render.errors import RenderError
from thalweg.render.gpu import gpu_renderer
from thalweg.render.kernels.terrain.azimuth_planes import most_planes


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
    fast, full = (gpu_renderer.bytes_each(scene, 10, 20, fast) for fast in (True, False))
    assert full - fast == 10 * 20 * 12
    assert gpu_renderer.bytes_of(scene) > scene.top.nbytes + scene.atlas.nbytes
    wide = gpu_renderer.bytes_each(scene, 10, 40, True)
    # Twenty columns more take their planes, and the nearness of the vertical planes that serve them.
    assert wide - fast == 10 * 20 * 25 + 10 * (most_planes(40) - most_planes(20)) * 4
    assert most_planes(20) == 48 + 17
