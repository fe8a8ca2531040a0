"""Tests of the renderer whose worlds are replaced: its frames are those of a renderer of the same worlds."""

from dataclasses import replace

import numpy as np
import pytest

from tests.render.plain import plane, plants_at
from thalweg.render import Camera, Renderer, RenderError
from thalweg.render.slot_renderer import SlotRenderer
from thalweg.world import World

CAMERA = Camera(24, 24)


def worlds() -> list[World]:
    """Four worlds with different maps, plants and bridges."""
    arch = np.array([[6.0, 0.0, 1.5, 12.0, 3.0, 8.0, 0.5, 2.0, 4.0, 0.2, 1.0]])
    some = plane(plants=plants_at([(4.0, 2.0), (7.0, -3.0)], 3))
    many = plane(plants=plants_at([(float(x), float(y)) for x in range(3, 40) for y in range(-9, 9)], 2))
    return [some, replace(plane(), bridges=arch), many, replace(some, seed=5)]


def frames_of(renderer: Renderer, index: list[int]) -> np.ndarray:
    poses = np.array([[0.0, 0.0, 3.0, 0.1 * row] for row in range(len(index))])
    return renderer.render(poses, index, np.arange(len(index)) * 1.0)


def test_worlds_are_replaced_and_others_stay_as_they_were():
    all_four = Renderer(worlds(), CAMERA)
    slots = SlotRenderer(CAMERA)
    slots.reserve(2)
    slots.put(0, slots.bake(worlds()[0]))
    held = [0, 0]
    for slot, world in ((1, 3), (0, 2), (1, 1), (0, 3), (1, 2), (0, 1), (1, 0)):
        slots.put(slot, slots.bake(worlds()[world]))
        held[slot] = world
        expected = frames_of(all_four, [held[0], held[1], held[0]])
        assert np.array_equal(frames_of(slots, [0, 1, 0]), expected)
        assert not np.array_equal(expected[0], expected[1]) or held[0] == held[1]


def test_a_sun_of_another_height_is_refused():
    slots = SlotRenderer(CAMERA)
    slots.reserve(2)
    slots.put(0, slots.bake(worlds()[0]))
    with pytest.raises(RenderError, match="sun of all worlds must stand"):
        slots.put(1, slots.bake(worlds()[0])._replace(sun_elevation=0.5))


def test_a_slot_without_a_world_is_refused():
    slots = SlotRenderer(CAMERA)
    slots.reserve(2)
    slots.put(0, slots.bake(worlds()[0]))
    with pytest.raises(RenderError, match=r"world_index must be in 0\.\.0"):
        frames_of(slots, [1])
