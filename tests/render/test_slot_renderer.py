"""Tests of the renderer whose worlds are replaced: its frames are those of a renderer of the same worlds."""

from dataclasses import replace

import numpy as np
import pytest

from tests.render.plain import plane, plants_at
from thalweg.render import Camera, Renderer, RenderError
from thalweg.render.bake.scene_slots import MARGIN
from thalweg.render.records.randomisation import Randomisation
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


def test_a_slot_has_room_for_worlds_that_are_a_little_larger():
    slots = SlotRenderer(CAMERA)
    slots.reserve(1)
    small, _, large, _ = map(slots.bake, worlds())
    assert large.nbytes == int(MARGIN * sum(table.nbytes for table in large.tables.values())) > small.nbytes


def under_suns(worlds: list[World]) -> list[World]:
    """The worlds, with suns of two heights by turns."""
    return [replace(world, sun_elevation=(0.9, 0.5)[index % 2]) for index, world in enumerate(worlds)]


def test_worlds_under_suns_of_different_heights_have_their_own_pictures_of_plants():
    lit = under_suns([worlds()[0], worlds()[2], worlds()[2], worlds()[0]])
    together = Renderer(lit, CAMERA)
    slots = SlotRenderer(CAMERA)
    slots.reserve(2)
    held = [0, 0]
    for slot, world in ((0, 0), (1, 1), (0, 3), (1, 2), (0, 1)):
        slots.put(slot, slots.bake(lit[world]))
        held[slot] = world
    found = frames_of(slots, [0, 1])
    assert np.array_equal(found, frames_of(together, held))
    other = Renderer([replace(lit[held[0]], sun_elevation=0.9), lit[held[1]]], CAMERA)
    assert not np.array_equal(found[0], frames_of(other, [0, 1])[0])


def test_each_world_has_a_sun_of_its_own_if_suns_vary():
    ranges = Randomisation(suns=4)
    slots = SlotRenderer(CAMERA, randomisation=ranges)
    slots.reserve(2)
    for slot, world in enumerate((worlds()[0], worlds()[3])):
        slots.put(slot, slots.bake(world))
    lights = [replace(ranges, suns=1).lights(world.seed)[0] for world in (worlds()[0], worlds()[3])]
    assert lights[0] != lights[1]
    lit = [world.relit(*light) for world, light in zip((worlds()[0], worlds()[3]), lights, strict=True)]
    assert np.array_equal(frames_of(slots, [0, 1]), frames_of(Renderer(lit, CAMERA), [0, 1]))


def test_a_slot_without_a_world_is_refused():
    slots = SlotRenderer(CAMERA)
    slots.reserve(2)
    slots.put(0, slots.bake(worlds()[0]))
    with pytest.raises(RenderError, match=r"world_index must be in 0\.\.0"):
        frames_of(slots, [1])
