"""Worlds that many tests share, taken from the cache folder where they were built before."""

import pytest

from thalweg.world import World, load_or_build


@pytest.fixture(scope="session")
def easy_world() -> World:
    """The fixed river of the level Easy."""
    return load_or_build("Easy")


@pytest.fixture(scope="session")
def medium_world() -> World:
    """The fixed river of the level Medium."""
    return load_or_build("Medium")


@pytest.fixture(scope="session")
def hard_world() -> World:
    """The fixed river of the level Hard."""
    return load_or_build("Hard")
