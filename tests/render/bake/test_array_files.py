"""Tests of the hashes that name files of arrays."""

from dataclasses import fields, is_dataclass, replace

import numpy as np

from tests.render.plain import plane, plants_at
from thalweg.render.bake.array_files import digest_of
from thalweg.world.banks import BankReach


def test_the_digest_follows_every_field_of_a_world():
    world = plane(plants=plants_at([(0.0, 0.0)], 3))
    digests = {digest_of(changed) for changed in (world, *variants(world))}
    assert len(digests) == 1 + sum(1 for _ in variants(world)) > 20


def variants(record):
    """Yield copies of a record that differ from it in one value of one field."""
    for field in fields(record):
        value = getattr(record, field.name)
        if is_dataclass(value):
            yield from (replace(record, **{field.name: inner}) for inner in variants(value))
        elif isinstance(value, np.ndarray):
            if value.size:
                other = value.copy()
                other.flat[-1] = 0 if value.flat[-1] else 1
                yield replace(record, **{field.name: other})
            yield replace(record, **{field.name: value[..., None]})
        elif isinstance(value, bool):
            yield replace(record, **{field.name: not value})
        elif isinstance(value, tuple):
            yield replace(record, **{field.name: (*value, BankReach("meadow"))})
        else:
            yield replace(record, **{field.name: value + type(value)(1)})
