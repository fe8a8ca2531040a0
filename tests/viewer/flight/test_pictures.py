"""Tests of the pictures that a page shows."""

import io

import numpy as np
from PIL import Image

from tests.viewer.flight.conftest import Fly
from thalweg.render.records.classes import PLANT, WATER
from thalweg.viewer.flight.pictures import CLASS_COLOURS, FAR_M, SKY, STOPS, depth_colours, encoded, pictures, seen_by


def opened(content: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(content)))


def test_all_pictures_of_a_flight_have_the_size_that_was_chosen(fly: Fly):
    drawn = pictures(fly(size_px=48), ["camera", "mask", "depth", "class"])
    assert {kind: opened(content).shape[:2] for kind, content in drawn.items()} == dict.fromkeys(drawn, (48, 48))


def test_the_camera_shows_the_frame_up_to_the_loss_of_jpeg(fly: Fly):
    flight = fly(size_px=64)
    frame = flight.env.frames.render(flight.views())[0, ..., :3]
    assert np.abs(opened(pictures(flight, ["camera"])["camera"]).astype(int) - frame).mean() < 6


def test_depths_have_colours_from_near_to_far_and_the_sky_its_own():
    colours = depth_colours(np.array([[0.5, 1.0, FAR_M**0.5, FAR_M, 900.0, -1.0]], np.float32))[0]
    assert colours.tolist() == [list(each) for each in (STOPS[0], STOPS[0], STOPS[2], STOPS[4], STOPS[4], SKY)]


def test_classes_have_their_colours():
    image = opened(encoded("class", np.repeat(np.array([[WATER], [PLANT]], np.uint8), 16, axis=1).repeat(8, axis=0)))
    assert np.abs(image[4, 8].astype(int) - CLASS_COLOURS["water"]).max() <= 3
    assert np.abs(image[12, 8].astype(int) - CLASS_COLOURS["plant"]).max() <= 3


def test_what_a_policy_sees_stands_side_by_side():
    seen = np.zeros((4, 4, 4), np.uint8)
    seen[..., 0], seen[..., 3] = 9, 255
    decoded = np.full((4, 4, 1), 128, np.uint8)
    panels = np.split(opened(seen_by(seen, decoded)), 3, axis=1)
    assert [panel[0, 0].tolist() for panel in panels] == [[9, 0, 0], [255, 255, 255], [128, 128, 128]]
    assert opened(seen_by(seen[..., :3], None)).shape == (4, 4, 3)
