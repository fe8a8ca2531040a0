"""Quantities that an encoder of geometry predicts: which objects are in view by hand, mirror images, and names."""

import math

import numpy as np
import pytest

from thalweg.encoder import EncoderInputError
from thalweg.env.task.ideal_eye import FEATURES
from thalweg.env.task.priced.eye import features_of
from thalweg.env.tasks import TASKS
from thalweg.render.optics.lens import Lens
from thalweg.render.records.camera import Camera
from thalweg.render.records.props import PropKind
from thalweg.train.encoder.targets import (
    TASK_TARGETS,
    TOLD,
    in_image,
    mirrored_targets,
    nearest_in_view,
    shown_of,
    targets_of,
    weights_of,
)

SWIMMER, KAYAK, BUOY, STATION = PropKind.SWIMMER, PropKind.KAYAK, PropKind.BUOY, PropKind.STATION
MOVERS = (SWIMMER, KAYAK)
NORTH = np.array([[100.0, 50.0, 8.0, math.pi / 2]])
"""A pose 6 m above water at the height 2 m, that looks north."""


def place(kind: int, ahead: float, left: float, yaw: float = 0.0) -> list[float]:
    """An object on the water, so far ahead and to the left of `NORTH`, that points to the right of the image."""
    return [kind, 100.0 - left, 50.0 + ahead, 2.0, yaw, 0.1]


def seen(*props: list[float], kinds: tuple = MOVERS, count: int = 2) -> list[list[float]]:
    return nearest_in_view(Camera(), NORTH, np.array([props], np.float32).reshape(1, -1, 6), kinds, count)[0].tolist()


def test_the_nearest_objects_in_the_image_are_told_and_no_others():
    hidden = [
        place(SWIMMER, 3.0, 0.0),  # 63 degrees below the horizon: under the image, which ends at 50
        place(SWIMMER, -5.0, 0.0),  # behind
        place(SWIMMER, -38.0, 0.0),  # behind, on a line through the image
        place(BUOY, 8.0, 0.0),  # of another kind
        place(SWIMMER, 12.0, 9.0),  # beside the image
        place(SWIMMER, 45.0, 0.0),  # out of range
        [0.0] * 6,
    ]
    far, near = place(SWIMMER, 20.0, 5.0), place(KAYAK, 10.0, -1.0)
    found = seen(*hidden, far, near)
    wanted = [[math.hypot(10, 1), 10.0, -1.0], [math.hypot(20, 5), 20.0, 5.0]]
    np.testing.assert_allclose(found, wanted, atol=1e-4)
    assert seen(*hidden) == [[40.0, 0.0, 0.0]] * 2 and seen() == [[40.0, 0.0, 0.0]] * 2
    np.testing.assert_allclose(seen(*hidden, far), [wanted[1], [40.0, 0.0, 0.0]], atol=1e-4)
    np.testing.assert_allclose(seen(far, place(SWIMMER, 15, 0), near, count=1), wanted[:1], atol=1e-4)


@pytest.mark.parametrize(("aside", "inside"), [(7.6, True), (-7.6, True), (7.8, False), (-7.8, False)])
def test_the_field_of_view_ends_where_the_image_does(aside: float, inside: bool):
    # At 12 m, seen 6 m from above and 20 degrees down, the axis is 12 cos 20 + 6 sin 20 = 13.33 m long; its half width
    # is tan 30 of that, 7.70 m. A buoy is a point.
    assert (seen(place(BUOY, 12.0, aside), kinds=(BUOY,))[0][0] < 40.0) == inside


@pytest.mark.parametrize(("ahead", "inside"), [(5.2, True), (4.9, False)])
def test_the_image_ends_before_the_vehicle(ahead: float, inside: bool):
    # The lower edge points 50 degrees down: 6 / tan 50 = 5.03 m.
    assert (seen(place(STATION, ahead, 0.0), kinds=(STATION,), count=1)[0][0] < 40.0) == inside


def test_an_object_of_which_an_end_is_in_the_image_is_told_by_its_middle():
    # The image begins at 5.03 m: of these, ends lie at 5.5 m and 5.2 m, and of those that follow at 4.9 m at most.
    for kind, ahead, yaw in ((KAYAK, 3.4, 1.0), (KAYAK, 3.4, -1.0), (SWIMMER, 4.5, 1.0), (STATION, 2.6, -1.0)):
        found = seen(place(kind, ahead, 0.0, yaw * math.pi / 2), kinds=(kind,), count=1)[0]
        np.testing.assert_allclose(found, [ahead, ahead, 0.0], atol=1e-4)
    for kind, ahead, yaw in ((KAYAK, 2.8, 1.0), (SWIMMER, 4.2, 1.0), (STATION, 2.6, 1.0), (BUOY, 4.9, 1.0)):
        assert seen(place(kind, ahead, 0.0, yaw * math.pi / 2), kinds=(kind,), count=1) == [[40.0, 0.0, 0.0]]


def test_mirror_images_of_objects_have_mirrored_places():
    rng = np.random.default_rng(0)
    poses = rng.uniform([-5, -5, 3, -3], [5, 5, 9, 3], (40, 4))
    props = rng.uniform([1, -40, -40, 0, 0, 0], [1, 40, 40, 1, 3, 3], (40, 12, 6))
    truths = np.zeros((2, 40, len(targets_of(("Swimmers",)))), np.float32)
    for image, sign in enumerate((1.0, -1.0)):
        turned, moved = poses * [1, sign, 1, sign], props * [1, 1, sign, 1, sign, 1]
        truths[image, :, len(FEATURES) :] = nearest_in_view(Camera(), turned, moved, MOVERS, 2).reshape(40, -1)
    assert (truths[0, :, len(FEATURES)] < 40).sum() > 10
    np.testing.assert_allclose(mirrored_targets(truths[0], targets_of(("Swimmers",))), truths[1], atol=1e-4)


def test_only_what_lies_to_the_left_changes_its_sign_in_a_mirror():
    names = targets_of(tuple(TASKS))
    ones = mirrored_targets(np.ones((1, len(names)), np.float32), names)[0]
    turned = {name for name, value in zip(names, ones, strict=True) if value < 0} - set(FEATURES)
    assert turned == {"swimmer in view left", "second swimmer in view left", "station in view left"}


def test_names_are_unique_and_what_no_frame_shows_is_left_out():
    assert targets_of(("River",)) == FEATURES and set(TASK_TARGETS) == set(TASKS)
    names = targets_of(tuple(TASKS))
    assert len(set(names)) == len(names) == len(FEATURES) + 6 + 3 + 1 + 4
    assert not {"time left", "way to the station"} & set(names)
    assert all(set(told) <= set(features_of(task)) for task, told in TOLD.items())
    assert targets_of(("Nests", "River")) == (*FEATURES, "in a reserve", "reserve begins", "reserve ends")


def test_what_decides_a_cost_weighs_twice():
    names = targets_of(tuple(TASKS))
    weights = dict(zip(names, weights_of(names), strict=True))
    doubled = {name for name in names[len(FEATURES) :] if weights[name] == 2.0}
    nearest = {f"swimmer in view {what}" for what in ("distance", "ahead", "left")}
    assert doubled == nearest | {"reserve begins", "clearance", "over land"}
    assert weights["second swimmer in view left"] == weights["bridge"] == 1.0 and weights["left bank"] == 4.0
    assert shown_of(FEATURES) == ("left bank", "right bank", "heading error", "height")
    assert shown_of(targets_of(("RacingLine",)))[4:] == ("clearance",)


@pytest.mark.parametrize(
    ("tasks", "told"),
    [
        (("River", "Swimers"), r"unknown task 'Swimers' \(did you mean 'Swimmers'\?\); known: River, Swimmers, Nests"),
        (("Nests", "Nests"), "tasks must be at least one, each once, not Nests, Nests"),
        ((), "tasks must be at least one, each once, not none"),
    ],
)
def test_unknown_tasks_and_tasks_twice_are_refused(tasks: tuple[str, ...], told: str):
    with pytest.raises(EncoderInputError, match=told):
        targets_of(tasks)


def test_behind_a_lens_in_view_is_what_the_lens_shows():
    # The first two are 45 degrees to the left and right; the image, whose axis is on the right, shows more of the left.
    camera = Camera(fov_deg=80.0, pitch_deg=0.0, lens=Lens("plumb_bob", (-0.05,), offset_x_px=20.0))
    poses = np.array([[0.0, 0.0, 1.0, 0.0]])
    points = np.array([[[5.0, 5.0, 1.0], [5.0, -5.0, 1.0], [5.0, -2.0, 1.0]]])
    assert in_image(camera, poses, points).tolist() == [[True, False, True]]
