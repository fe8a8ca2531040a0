"""The pictures of the findings: for each row a point with its interval, or several beside one another."""

import io

from headline import Headline
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from thalweg.bench.report.figures import COLOURS, STYLE, png
from thalweg.bench.results.inference import Estimate, Proportion

WIDTH_IN, ROW_IN, FRAME_IN = 6.0, 0.19, 0.85
"""Width of a picture, height of a row, and of what is above and below the rows."""
MARKERS = "osD^"
SPREAD = 0.22
"""Distance of the points of a row from each other, in rows."""
COLOURS_KEPT = 48
"""Colours of a picture's palette."""


def drawn(headline: Headline) -> bytes:
    """Return the picture of a finding as a PNG."""
    with rc_context(STYLE):
        picture = Image.open(io.BytesIO(png(figure_of(headline)))).convert("RGB").quantize(COLOURS_KEPT)
    written = io.BytesIO()
    picture.save(written, "PNG", optimize=True)
    return written.getvalue()


def figure_of(headline: Headline) -> Figure:
    """Return the figure of a finding, in the style that is set."""
    figure = Figure(figsize=(WIDTH_IN, FRAME_IN + ROW_IN * max(len(headline.labels), 3)))
    axis = figure.subplots()
    for index, (words, values) in enumerate(headline.series.items()):
        shift = (index - (len(headline.series) - 1) / 2) * SPREAD
        for row, value in enumerate(values):
            if value is not None:
                _point(axis, row + shift, value, index)
        axis.plot([], [], MARKERS[index], color=COLOURS[index], markersize=4, label=words)
    if headline.line is not None:
        axis.axvline(headline.line, color="0.4", linestyle="--", linewidth=0.9, zorder=0)
    axis.set_yticks(range(len(headline.labels)), labels=headline.labels)
    axis.set(ylim=(len(headline.labels) - 0.5, -0.5), xlabel=headline.axis)
    axis.set_xlim(left=0.0)
    if any(isinstance(each, Proportion) for values in headline.series.values() for each in values):
        axis.set_xlim(0.0, 1.0)
    if len(headline.series) > 1:
        figure.legend(loc="outside upper right", ncols=len(headline.series), frameon=False, fontsize=8)
    return figure


def _point(axis: Axes, height: float, value: Estimate, index: int) -> None:
    """Draw a value and its interval, if it has one; a hollow marker has none."""
    known = value.low == value.low
    if known:
        axis.plot([value.low, value.high], [height, height], color=COLOURS[index], linewidth=1.2, alpha=0.7)
    face = COLOURS[index] if known else "white"
    axis.plot(
        value.value, height, MARKERS[index], color=COLOURS[index], markerfacecolor=face, markersize=4.5, clip_on=False
    )
