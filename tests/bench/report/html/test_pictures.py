"""Tests of the small copies of figures on the page: their size, and that they show the same."""

import io

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from thalweg.bench.report.figures import png
from thalweg.bench.report.html.pictures import COLOURS, for_the_page


def pixels(content: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(content)).convert("RGB")).astype(float)


def encoded(picture: np.ndarray) -> bytes:
    written = io.BytesIO()
    Image.fromarray(picture).save(written, "PNG")
    return written.getvalue()


def test_a_plot_is_smaller_and_looks_the_same():
    figure = Figure(figsize=(9, 6))
    axis = figure.subplots()
    for shift in range(12):
        axis.plot(np.linspace(0, 9, 300), np.sin(np.linspace(0, 9, 300) + shift), alpha=0.7)
    drawn = png(figure)
    small = for_the_page(drawn)
    assert small.media_type == "image/png" and small.size_px == (1350, 900)
    assert len(small.content) < 0.6 * len(drawn)
    difference = np.abs(pixels(small.content) - pixels(drawn))
    assert difference.mean() < 0.5 and np.percentile(difference, 99.9) < 40


def test_a_plot_of_few_colours_keeps_every_bit():
    picture = np.random.default_rng(0).integers(0, 6, (40, 60, 3), dtype=np.uint8) * 51
    assert len({tuple(colour) for colour in picture.reshape(-1, 3)}) <= COLOURS
    assert np.array_equal(pixels(for_the_page(encoded(picture)).content), picture)


def test_a_photographic_picture_is_a_jpeg():
    smooth = np.add.outer(np.linspace(0, 200, 300), np.linspace(0, 50, 400))
    noise = np.random.default_rng(0).normal(0, 8, (300, 400, 3))
    picture = np.clip(smooth[..., None] + noise, 0, 255).astype(np.uint8)
    small = for_the_page(encoded(picture), photographic=True)
    assert small.media_type == "image/jpeg" and small.content[:2] == b"\xff\xd8" and small.size_px == (400, 300)
    assert len(small.content) < len(encoded(picture)) / 4
    assert np.abs(pixels(small.content) - picture).mean() < 8
