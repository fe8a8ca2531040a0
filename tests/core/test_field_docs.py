"""Tests of reading the docstrings of fields from the source of dataclasses."""

from dataclasses import dataclass

from thalweg.core.field_docs import field_docs


@dataclass(frozen=True)
class Base:
    """A class with one field of each kind."""

    first: int = 1
    """First of
    all."""
    second: int = 2
    third: int = 3
    """Third."""


@dataclass(frozen=True)
class Derived(Base):
    third: int = 4
    """Third, again."""
    fourth: int = 5
    """Fourth."""

    def method(self) -> None:
        """Not of a field."""


def test_the_text_after_a_field_is_its_own_and_that_of_the_derived_class_counts():
    assert field_docs(Derived) == {"first": "First of all.", "third": "Third, again.", "fourth": "Fourth."}


def test_a_class_without_source_has_none():
    assert field_docs(type("Made", (), {"__annotations__": {"first": int}})) == {}
