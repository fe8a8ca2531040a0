"""Tests of the tables of replaceable worlds on a device: they are those of the host, wherever these move."""

import numpy as np
import pytest

from tests.render.test_slot_renderer import under_suns, worlds
from thalweg.core.compute import gpu
from thalweg.render.bake.scene_slots import COLUMNS, SceneSlots
from thalweg.render.gpu.slot_drawing import FEW, MANY, rounded_up
from thalweg.render.gpu.slot_tables import SlotTables
from thalweg.render.records.layout import GX


class Card:
    """Arrays of the host in place of a device's; counts the rows that are copied to it."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.rows = 0
        patch.setattr(gpu, "to_device", lambda array, device: np.array(array))
        patch.setattr(gpu, "zeros", lambda shape, kind, device: np.zeros(shape, kind))
        patch.setattr(gpu, "overwrite", self.overwrite)

    def overwrite(self, array: np.ndarray, begin: int, rows: np.ndarray, device: str) -> None:
        array[begin : begin + len(rows)] = rows
        self.rows += len(rows)


@pytest.fixture
def card(monkeypatch: pytest.MonkeyPatch) -> Card:
    return Card(monkeypatch)


def check(slots: SceneSlots, tables: SlotTables) -> None:
    """All tables of the device are those of the host, as far as slots are filled."""
    scene = slots.scene
    assert scene is not None
    filled = scene.extents[:, GX] > 0
    for name, expected in scene._asdict().items():
        rows = filled if name == "extents" else slice(None)
        np.testing.assert_array_equal(getattr(tables.scene, name)[rows], expected[rows], err_msg=name)


def test_tables_of_the_device_follow_those_of_the_host(card: Card):
    slots, lit = SceneSlots(), under_suns(worlds())
    slots.reserve(3)
    tables, moved = SlotTables(slots, "card"), []
    for slot, world in ((0, 0), (1, 1), (0, 2), (2, 3), (1, 2), (0, 0)):
        slots.put(slot, slots.bake(lit[world]))
        tables.put(slot)
        assert tables.stale
        moved.append(tables.update())
        assert not tables.stale
        check(slots, tables)
    # A second sun, and the world with many plants, need larger tables; nothing does after that.
    assert moved == [True, True, True, False, False, False]


def test_several_worlds_are_copied_together_before_a_draw(card: Card):
    slots = SceneSlots()
    slots.reserve(4)
    tables = SlotTables(slots, "card")
    for slot, world in enumerate(worlds()):
        slots.put(slot, slots.bake(world))
        tables.put(slot)
    assert tables.update()
    check(slots, tables)


def test_only_the_slot_of_a_replaced_world_is_copied(card: Card):
    slots = SceneSlots()
    slots.reserve(4)
    tables = SlotTables(slots, "card")
    for slot in range(4):
        slots.put(slot, slots.bake(worlds()[2]))
        tables.put(slot)
    tables.update()
    slots.put(1, slots.bake(worlds()[0]))
    tables.put(1)
    before = card.rows
    assert not tables.update()
    assert card.rows - before == 2 + sum(slots.rows[name] for name in COLUMNS)
    check(slots, tables)


def test_numbers_of_frames_are_rounded_up_to_a_few_that_are_recorded():
    assert [rounded_up(count) for count in (1, FEW, FEW + 1, MANY, MANY + 1, 4 * MANY)] == [
        FEW,
        FEW,
        2 * FEW,
        MANY,
        2 * MANY,
        4 * MANY,
    ]
