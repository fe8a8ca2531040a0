"""Tests of props as arguments: their shape, kinds and errors."""

import numpy as np
import pytest

from tests.render.plain import plane
from thalweg.render import Camera, Renderer, RenderError
from thalweg.render.records import classes
from thalweg.render.records.props import CLASS_OFFSET, MOST_PROPS, NO_PROPS, PropKind, checked_props


def test_no_props_are_those_of_any_number_of_frames():
    assert checked_props(None, 5) is NO_PROPS
    assert checked_props(np.zeros((5, 0, 6)), 5) is NO_PROPS


def test_props_become_rows_of_float32():
    rows = checked_props([[[PropKind.BUOY, 1, 2, 3, 0.5, 0.25]], [[PropKind.NONE, 0, 0, 0, 0, 0]]], 2)
    assert rows.shape == (2, 1, 6) and rows.dtype == np.float32 and rows.flags.c_contiguous
    np.testing.assert_array_equal(rows[0, 0], [3, 1, 2, 3, 0.5, 0.25])


def test_the_class_of_a_prop_has_the_name_of_its_kind():
    for kind in list(PropKind)[1:]:
        assert kind + CLASS_OFFSET == getattr(classes, kind.name)
    assert max(PropKind) + CLASS_OFFSET + 1 == len(classes.CLASSES)


def buoy(**changed: float) -> np.ndarray:
    columns = {"kind": PropKind.BUOY, "x": 0.0, "y": 0.0, "z": 0.0, "yaw": 0.0, "phase": 0.0} | changed
    return np.array([[list(columns.values())]], np.float64)


@pytest.mark.parametrize(
    ("props", "message"),
    [
        (np.zeros((1, 6)), r"shape \[1, 6\]; they must be \[1, P, 6\]: one list for each pose, of kind, x, y, z, yaw"),
        (np.zeros((2, 1, 6)), r"shape \[2, 1, 6\]; they must be \[1, P, 6\]"),
        (np.zeros((1, 1, 5)), r"shape \[1, 1, 5\]; they must be \[1, P, 6\]"),
        (np.zeros((1, MOST_PROPS + 1, 6)), "65 props a frame: at most 64"),
        (buoy(y=np.nan), r"props\[0, 0, 2\] is nan; it must be finite"),
        (buoy(phase=np.inf), r"props\[0, 0, 5\] is inf; it must be finite"),
        (buoy(kind=9), r"props\[0, 0\] has kind 9; it must be one of 0 NONE, 1 SWIMMER, 2 KAYAK, 3 BUOY, 4 STATION"),
        (buoy(kind=2.5), r"props\[0, 0\] has kind 2.5"),
    ],
)
def test_bad_props_are_refused_by_name_before_anything_is_drawn(props: np.ndarray, message: str):
    renderer = Renderer([plane()], Camera(16, 16))
    out = np.full((1, 16, 16, 4), 7, np.uint8)
    with pytest.raises(RenderError, match=message):
        renderer.render([[0, 0, 2, 0]], out=out, props=props)
    assert (out == 7).all()
    with pytest.raises(RenderError, match=message):
        renderer.render_mask([[0, 0, 2, 0]], props=props)
    with pytest.raises(RenderError, match=message):
        renderer.render_layers([[0, 0, 2, 0]], props=props)
