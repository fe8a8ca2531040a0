"""Figure of originals, masks and reconstructions side by side, as a PNG."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from thalweg.core.atomic_io import atomic_path
from thalweg.encoder.encoder import Encoder
from thalweg.encoder.vae import EncoderInputError

GAP_PX = 4
LABEL_PX = 16


def draw_reconstructions(images: np.ndarray, encoders: Encoder | Mapping[str, Encoder], path: str | Path) -> None:
    """Write a PNG with a column per image uint8 [K, H, W, 4]: original, mask, then what each encoder keeps of both.

    `encoders` is one encoder, or several by the name that is written over their rows.
    """
    if not len(images):
        raise EncoderInputError("a figure needs at least one image")
    named = encoders if isinstance(encoders, Mapping) else {encoders.inputs: encoders}
    rows = {"original": images[..., :3], "water mask": _grey(images[..., 3:])}
    for name, encoder in named.items():
        decoded = encoder.decode(encoder(images))
        if decoded.shape[-1] >= 3:
            rows[f"{name}: reconstruction"] = decoded[..., :3]
        if decoded.shape[-1] != 3:
            rows[f"{name}: reconstructed mask"] = _grey(decoded[..., -1:])
    height, width = images.shape[1:3]
    sheet = Image.new(
        "RGB", (len(images) * (width + GAP_PX) + GAP_PX, len(rows) * (height + LABEL_PX + GAP_PX)), "white"
    )
    pen = ImageDraw.Draw(sheet)
    for row, (title, pictures) in enumerate(rows.items()):
        top = row * (height + LABEL_PX + GAP_PX)
        pen.text((GAP_PX, top + 2), title, fill="black")
        for column, picture in enumerate(pictures):
            sheet.paste(
                Image.fromarray(np.ascontiguousarray(picture)), (GAP_PX + column * (width + GAP_PX), top + LABEL_PX)
            )
    with atomic_path(path) as draft:
        sheet.save(draft, format="PNG")


def _grey(mask: np.ndarray) -> np.ndarray:
    return np.repeat(mask, 3, axis=-1)
