"""Tables, page and figure of the encoder study, computed from its measures."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.report.figures import STYLE
from thalweg.bench.report.published import RELATIVE_ENTROPY
from thalweg.bench.report.table import frame, markdown
from thalweg.core.config import frozen_config
from thalweg.encoder import VAEConfig
from thalweg.encoder.entropy import SMOOTHING, relative_entropy
from thalweg.env.task.ideal_eye import RANGE_M

OTHER_SMOOTHINGS = (1e-9, 1e-4, 1e-3)
"""Alternative smoothing constants, which show how much the choice matters."""
CASE = ("architecture", "inputs", "numbers")
ERRORS = ("train_mse", "held_out_mse", "mean_image_mse")
RIVER = ("iou_mask", "iou_colours", "iou_ceiling")
PROBED = ("left bank", "right bank", "heading error", "height", "bridge")
"""Numbers of the ideal eye that codes are probed for; the bridge where one is seen."""
READ = tuple(f"read_{name.replace(' ', '_')}" for name in PROBED)
SIZE_COLUMNS = (*CASE, *ERRORS, *RIVER, *READ)
PACKAGED_COLUMNS = ("encoder", "numbers", *READ)
ENTROPY_COLUMNS = ("first", "second", "paper", *(f"smoothing_{value:g}" for value in (SMOOTHING, *OTHER_SMOOTHINGS)))
Measures = Mapping[str, Any]
"""By the names of `ERRORS` and `RIVER`, None where an input has none; and `read`: R² by the names of
`PROBED`."""


@frozen_config(ResultsError)
class Case:
    """An encoder of the study."""

    inputs: str
    latent: int
    """Numbers in a code."""
    architecture: str = "lean"

    @property
    def name(self) -> str:
        """Name of its folder."""
        return f"{self.architecture}-{self.inputs.replace('+', '-')}-{self.latent}"

    @property
    def config(self) -> VAEConfig:
        """Config of its VAE."""
        return VAEConfig(inputs=self.inputs, latent=self.latent, architecture=self.architecture)


def size_row(case: Case, found: Measures) -> dict[str, str]:
    """Return a row of sizes.csv; measures that an input does not have are empty."""
    values = {name: found[name] for name in (*ERRORS, *RIVER)}
    values |= {column: found["read"][name] for column, name in zip(READ, PROBED, strict=True)}
    cells = {name: "" if value is None or math.isnan(value) else f"{value:.5f}" for name, value in values.items()}
    return {"architecture": case.architecture, "inputs": case.inputs, "numbers": str(case.latent)} | cells


def packaged_row(name: str, latent: int, read: np.ndarray) -> dict[str, str]:
    """Return a row of packaged.csv: an encoder, its code size, and R² [T] with which its codes tell `PROBED`."""
    cells = {column: "" if math.isnan(value) else f"{value:.5f}" for column, value in zip(READ, read, strict=True)}
    return {"encoder": name, "numbers": str(latent)} | cells


def entropy_rows(codes: dict[str, np.ndarray]) -> Iterator[list[str]]:
    """Yield a row of entropy.csv for each pair of inputs, with the paper's value and ours."""
    for (first, second), published in RELATIVE_ENTROPY.items():
        if first in codes and second in codes:
            ours = [
                relative_entropy(codes[first], codes[second], smoothing) for smoothing in (SMOOTHING, *OTHER_SMOOTHINGS)
            ]
            yield [first, second, f"{published:.3f}", *(f"{value:.3f}" for value in ours)]


def page(
    about: str,
    rows: Sequence[Mapping[str, str]],
    entropies: Sequence[list[str]],
    packaged: Sequence[Mapping[str, str]] = (),
) -> str:
    """Return the page in Markdown: the tables and the meaning of their columns; `about` describes the training."""
    parts = [
        f"# The encoder study\n\n{about}\n\n## Code size, preservation of the river, and linear probes\n",
        table(rows, (*CASE, *ERRORS, *RIVER)),
        "The errors are mean squared errors of values in 0..1. The other columns are the IoU of the water on held-out"
        " images: in the reconstructed mask, and in the reconstructed colours, as segmented by a network that was"
        " trained on frames. `iou ceiling` is what this network reaches on the frames themselves.\n",
        table(rows, (*CASE, *READ)),
        "R² on held-out images of a linear regression on the code. It predicts the distances to the banks, heading"
        " error, height above the water, and the distance along the course to the middle of the next bridge within"
        f" {RANGE_M:g} m.\n",
    ]
    if packaged:
        parts += [
            table(packaged, PACKAGED_COLUMNS),
            "The same for the encoders that come with the package, which were trained on other frames.\n",
        ]
    if entropies:
        parts += [
            "## Inputs: relative entropy of the codes\n",
            markdown(frame(ENTROPY_COLUMNS, entropies)),
            f"In nats, mean over the numbers of the codes. {SMOOTHING:g}, or the value that a column names, is added to"
            " the share of each bin. `paper` is the paper's figure, which was measured in another simulator with an"
            " unknown value.\n",
        ]
    return "\n".join(parts)


def table(rows: Sequence[Mapping[str, str]], columns: Sequence[str]) -> str:
    """Return some columns of rows as a Markdown table with readable headings."""
    names = [name.removeprefix("read_").replace("_", " ") for name in columns]
    return markdown(frame(names, ([row[name] for name in columns] for row in rows)))


def size_figure(known: Mapping[Case, Measures]) -> Figure:
    """Return the figure of the reconstruction error against the code size."""
    with rc_context(STYLE):
        figure = Figure(figsize=(6, 3.6))
        axis = figure.subplots()
        for architecture, marker in (("lean", "o-"), ("paper", "s")):
            cases = sorted(
                (case for case in known if (case.architecture, case.inputs) == (architecture, "rgb+mask")),
                key=lambda case: case.latent,
            )
            for what, colour in (("train_mse", "C0"), ("held_out_mse", "C1")):
                label = f"{architecture}, {'trained on' if what == 'train_mse' else 'held out'}"
                errors = [known[case][what] for case in cases]
                if cases:
                    axis.plot([case.latent for case in cases], errors, marker, color=colour, label=label)
        axis.set_xscale("log", base=2)
        sizes = sorted({case.latent for case in known})
        axis.set_xticks(sizes, [str(size) for size in sizes], minor=False)
        axis.set_xlabel("numbers in a code")
        axis.set_ylabel("mean squared error")
        axis.set_ylim(bottom=0)
        axis.legend(frameon=False)
    return figure
