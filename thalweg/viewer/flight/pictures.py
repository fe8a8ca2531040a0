"""Pictures of a flight as bytes that browsers show: camera, water mask, depth and classes."""

import io
from collections.abc import Collection
from typing import Any, Literal, get_args

import numpy as np
from PIL import Image

from thalweg.datasets.episode import FIELD_OF_LAYER
from thalweg.render.records.classes import CLASSES
from thalweg.viewer.flight.flight import Flight

PictureKind = Literal["camera", "mask", "depth", "class"]
KINDS: tuple[PictureKind, ...] = get_args(PictureKind)
FIELDS = {"camera": "rgb", **FIELD_OF_LAYER}
"""Field of a `thalweg.render.Frame` that each picture shows."""
QUALITY = 88
"""Quality of JPEG; frames are noisy enough to hide its traces."""
NEAR_M, FAR_M = 1.0, 200.0
"""Depths at the ends of the colours, which are spaced by its logarithm."""
STOPS = ((253, 231, 37), (94, 201, 98), (33, 145, 140), (59, 82, 139), (68, 1, 84))
"""Colours from near to far, those of viridis."""
SKY = (16, 20, 26)
CLASS_COLOURS = dict(
    zip(
        CLASSES,
        (
            *((150, 190, 225), (38, 105, 180), (175, 145, 95), (60, 120, 55), (205, 200, 190)),
            *((235, 90, 60), (240, 160, 40), (245, 225, 60), (190, 80, 190)),
        ),
        strict=True,
    )
)
"""Colour of each class of what is seen."""


def pictures(flight: Flight, kinds: Collection[PictureKind], share: float = 1.0) -> dict[str, bytes]:
    """Return pictures of a flight, drawn at once: JPEG of the camera, else PNG; `share` as in `Flight.views`."""
    layers: Any = [FIELDS[kind] for kind in kinds]
    frame: Any = flight.env.frames.render_layers(flight.views(share), layers, flight.env.props())
    return {kind: encoded(kind, getattr(frame, FIELDS[kind])[0]) for kind in kinds}


def encoded(kind: PictureKind, layer: np.ndarray) -> bytes:
    """Return a layer [H, W, ...] of a `thalweg.render.Frame` as the bytes of a picture."""
    if kind == "camera":
        return _bytes(Image.fromarray(layer), "JPEG", quality=QUALITY)
    if kind == "mask":
        return _bytes(Image.fromarray(layer), "PNG", compress_level=1)
    colours = depth_colours(layer) if kind == "depth" else np.array(list(CLASS_COLOURS.values()), np.uint8)[layer]
    return _bytes(Image.fromarray(colours), "JPEG", quality=QUALITY, subsampling=0)


def depth_colours(depth_m: np.ndarray) -> np.ndarray:
    """Return colours [H, W, 3] uint8 of depths [H, W] in metres, of which those of the sky are negative."""
    share = np.log(np.clip(depth_m, NEAR_M, FAR_M) / NEAR_M) / np.log(FAR_M / NEAR_M)
    at = np.linspace(0.0, 1.0, len(STOPS))
    colours = np.stack([np.interp(share, at, channel) for channel in zip(*STOPS, strict=True)], axis=-1)
    colours[depth_m < 0] = SKY
    return np.rint(colours).astype(np.uint8)


def _bytes(picture: Image.Image, form: str, **options: Any) -> bytes:
    content = io.BytesIO()
    picture.save(content, format=form, **options)
    return content.getvalue()


def seen_by(seen: np.ndarray, decoded: np.ndarray | None) -> bytes:
    """Return what a policy sees as one PNG: colours, then the mask, then what an autoencoder makes of its code of them.

    seen, decoded: [H, W, C] uint8 with 1, 3 or 4 channels.
    """
    panels = _panels(seen) + ([] if decoded is None else _panels(decoded))
    return _bytes(Image.fromarray(np.concatenate(panels, axis=1)), "PNG", compress_level=1)


def _panels(image: np.ndarray) -> list[np.ndarray]:
    """Return the colours and the mask of an image [H, W, C], each [H, W, 3]."""
    colours = [image[..., :3]] if image.shape[-1] >= 3 else []
    mask = [np.repeat(image[..., -1:], 3, axis=2)] if image.shape[-1] != 3 else []
    return colours + mask
