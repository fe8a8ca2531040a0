"""Looks: each parameter does what it says and nothing else, against the reference and plain cameras."""

from dataclasses import replace

import numpy as np
import pytest

from tests.render.frames import on_river, psnr
from tests.render.plain import plane, plants_at
from thalweg.render import Camera, Look, Renderer
from thalweg.render.records.appearance import LIMITS, PARAMETERS, look_values
from thalweg.render.records.classes import PLANT
from thalweg.render.reference import frame as reference
from thalweg.world.record import World

POSE = np.array([[-20.0, 0.0, 3.0, 0.0]])


@pytest.mark.slow
@pytest.mark.parametrize(
    "look",
    [
        Look(haze=8.0, exposure_ev=-0.7, warmth=0.8, water_tint=0.7, turbidity=0.4, ripple=0.3, season=1.0),
        Look(haze=0.0, exposure_ev=0.5, warmth=-0.6, water_tint=-1.0, turbidity=2.5, ripple=1.6, plant_density=0.4),
        Look(pitch_deg=-9.0, fov_deg=14.0, season=0.5),
    ],
)
def test_the_kernel_agrees_with_the_reference_under_other_looks(easy_world: World, look: Look):
    camera = Camera(32, 32)
    pose = on_river(easy_world, 1, 4)
    ours = Renderer([easy_world], camera).render_layers(pose, look=look)
    truth = reference.draw(easy_world, pose[0], camera, samples=4, look=look)
    usual = reference.draw(easy_world, pose[0], camera, samples=4)
    assert psnr(ours.rgb[0], truth.rgb) > 22.0
    assert psnr(usual.rgb, truth.rgb) < 22.0  # the look is far from none
    assert np.mean(ours.mask[0] == truth.mask) > 0.99


def test_the_default_look_is_none_and_lens_and_pitch_are_those_of_a_camera(easy_world: World):
    pose = on_river(easy_world, 2, 1)
    renderer = Renderer([easy_world], Camera(32, 48))
    np.testing.assert_array_equal(renderer.render(pose), renderer.render(pose, look=Look()))
    turned = Renderer([easy_world], Camera(32, 48, fov_deg=70.0, pitch_deg=14.0)).render(pose)
    np.testing.assert_array_equal(turned, renderer.render(pose, look=Look(fov_deg=10.0, pitch_deg=-6.0)))


def test_each_frame_of_a_batch_has_its_own_look(easy_world: World):
    poses = np.repeat(on_river(easy_world, 1, 2), 3, axis=0)
    looks = [Look(), Look(season=1.0, noise=4.0), Look(haze=9.0, turbidity=3.0)]
    renderer = Renderer([easy_world], Camera(32, 32))
    together = renderer.render(poses, look=looks)
    for k, look in enumerate(looks):
        np.testing.assert_array_equal(together[k], renderer.render(poses[:1], look=look)[0])
    np.testing.assert_array_equal(
        together, renderer.render(poses, look=np.concatenate([look_values(x, 1) for x in looks]))
    )
    assert len(np.unique(together.reshape(3, -1), axis=0)) == 3


def test_noise_has_the_requested_deviation_no_bias_and_no_memory():
    renderer = Renderer([plane(grey=110)], Camera(128, 128, pitch_deg=80.0))
    pose = np.array([[0.0, 0.0, 30.0, 0.3]])
    clean = renderer.render(pose).astype(float)[0, ..., :3]
    noisy = renderer.render(pose, look=Look(noise=6.0)).astype(float)[0, ..., :3]
    assert clean.min() > 30
    assert clean.max() < 225
    added = noisy - clean
    assert abs(added.mean()) < 4 * 6.0 / np.sqrt(added.size)
    assert added.std() == pytest.approx(6.0, rel=0.02)
    assert abs(np.corrcoef(added[..., 0].ravel(), added[..., 1].ravel())[0, 1]) < 0.04
    assert abs(np.corrcoef(added[:, 1:, 0].ravel(), added[:, :-1, 0].ravel())[0, 1]) < 0.04
    again = renderer.render(pose, look=Look(noise=6.0))[0, ..., :3]
    later = renderer.render(pose, None, 0.25, look=Look(noise=6.0))[0, ..., :3]
    np.testing.assert_array_equal(again, noisy)
    assert (later != again).mean() > 0.5


def test_noise_and_light_leave_the_mask_alone(easy_world: World):
    pose = on_river(easy_world, 3, 9)
    renderer = Renderer([easy_world], Camera(32, 32))
    look = Look(noise=20.0, exposure_ev=1.5, warmth=1.0, haze=20.0, turbidity=5.0, ripple=3.0, season=1.0)
    np.testing.assert_array_equal(renderer.render(pose)[..., 3], renderer.render(pose, look=look)[..., 3])


def test_exposure_and_balance_move_the_colours_their_way():
    renderer = Renderer([plane(grey=90)], Camera(16, 16, pitch_deg=60.0))
    usual, bright, warm, cold = (
        renderer.render(POSE, look=look)[0, ..., :3].astype(float).mean((0, 1))
        for look in (Look(), Look(exposure_ev=1.0), Look(warmth=1.0), Look(warmth=-1.0))
    )
    assert (bright > usual + 20).all()
    assert warm[0] - warm[2] > usual[0] - usual[2] + 10
    assert cold[0] - cold[2] < usual[0] - usual[2] - 10


def test_fewer_plants_are_a_part_of_all_plants():
    places = [(float(x), float(y)) for x in range(-8, 9, 2) for y in range(-8, 9, 2)]
    renderer = Renderer([plane(plants=plants_at(places, 12, 1.2, 0.8))], Camera(96, 96, pitch_deg=35.0))
    pose = np.array([[-14.0, 0.0, 9.0, 0.0]])
    all_, half, none = (
        renderer.render_layers(pose, look=Look(plant_density=d)).class_id[0] == PLANT for d in (1.0, 0.5, 0.0)
    )
    assert not none.any()
    assert not (half & ~all_).any()
    assert half.sum() / all_.sum() == pytest.approx(0.5, abs=0.12)


def test_autumn_turns_leaves_and_leaves_stones_alone():
    leaf, stone = (
        Renderer([plane(plants=plants_at([(0.0, 0.0)], kind, 6.0, 6.0))], Camera(48, 48, pitch_deg=5.0))
        for kind in (9, 17)
    )
    for renderer, turns in ((leaf, True), (stone, False)):
        seen = renderer.render_layers(np.array([[-7.0, 0.0, 3.0, 0.0]])).class_id[0] == PLANT
        summer, autumn = (
            renderer.render(np.array([[-7.0, 0.0, 3.0, 0.0]]), look=Look(season=s))[0, ..., :3].astype(float)[seen]
            for s in (0.0, 1.0)
        )
        redder = (autumn[:, 0] - autumn[:, 1]).mean() - (summer[:, 0] - summer[:, 1]).mean()
        assert (redder > 10) == turns
        assert turns or np.array_equal(summer, autumn)


@pytest.mark.parametrize("name", LIMITS)
def test_a_look_outside_its_limits_is_refused_by_name(name: str):
    low, high = LIMITS[name]
    for value in (low - 0.01, high + 0.01, float("nan")):
        with pytest.raises(ValueError, match=f"{name} must be a number from {low:g} to {high:g}, got "):
            Look(**{name: value})
        rows = look_values(None, 2)
        rows[1, PARAMETERS.index(name)] = value
        with pytest.raises(ValueError, match=f"{name} must be a number from {low:g} to {high:g}, got "):
            look_values(rows, 2)
    replace(Look(), **{name: low})


def test_looks_that_do_not_fit_frames_or_camera_are_refused():
    renderer = Renderer([plane()], Camera(16, 16, fov_deg=120.0, pitch_deg=70.0))
    with pytest.raises(ValueError, match=r"looks have shape \[1, 12\]; expected \[2, 12\]"):
        renderer.render(np.repeat(POSE, 2, axis=0), look=[Look()])
    with pytest.raises(ValueError, match="fov_deg = 160; it must be from 5 to 150"):
        renderer.render(POSE, look=Look(fov_deg=40.0))
    with pytest.raises(ValueError, match="pitch_deg = 95; it must be from -89 to 89"):
        renderer.render(POSE, look=Look(pitch_deg=25.0))
