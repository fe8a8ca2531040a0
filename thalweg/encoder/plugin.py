"""Encoders from outside the package: any function from frames to codes, by a name and a version of its own."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from torch import Tensor

from thalweg.core.plugins.lookup import find
from thalweg.core.plugins.record import RESERVED, Plugin, PluginError, check_record
from thalweg.encoder.encoder import GROUP, PACKAGED, Encoder
from thalweg.encoder.files import frame_size_of
from thalweg.encoder.frame_size import checked_size, sides
from thalweg.encoder.vae import CHANNELS, VAE, EncoderInputError

Encode = Callable[[Tensor], Tensor]
"""Codes float32 [N, Z] of frames uint8 [N, H, W, C], on one device."""


@dataclass(frozen=True)
class EncoderPlugin:
    """An encoder from outside the package; docs/extend.md has an example.

    Raises `PluginError` for a name that is taken, a version below 1, and sizes or channels that cannot be.
    """

    name: str
    """Begins with a small letter."""
    make: Callable[[torch.device], Encode]
    """Returns the function from frames to codes, on a device. A frame must give the same code in any batch."""
    latent: int
    """Z, the number of dimensions of a code."""
    about: str
    """Description in one line."""
    version: int = 0
    """Version of its codes, 1 or more; to be raised when they change, as with other weights."""
    inputs: str = "rgb+mask"
    """Channels of the frames: "rgb", "mask" or "rgb+mask"."""
    size_px: int | tuple[int, int] = 128
    """H and W: a number for both, or a pair."""
    plugin_group: ClassVar[str] = GROUP

    def __post_init__(self) -> None:
        check_record(GROUP, self.name, self.version, (*PACKAGED, *RESERVED), capital=False)
        if not callable(self.make):
            raise PluginError(f"make of {self.name} is {self.make!r}; it must be called as make(device)")
        if self.inputs not in CHANNELS:
            raise PluginError(f"inputs of {self.name} are {self.inputs!r}; there are {', '.join(CHANNELS)}")
        if type(self.latent) is not int or self.latent < 1:
            raise PluginError(f"latent of {self.name} is {self.latent!r}; it must be a whole number above 0")
        try:
            object.__setattr__(self, "size_px", checked_size(self.size_px, 1))
        except ValueError as error:
            raise PluginError(f"size_px of {self.name}: {error}") from error

    @property
    def channels(self) -> tuple[int, ...]:
        """Channels of an RGB frame with its mask that it takes."""
        return CHANNELS[self.inputs]


class PluginEncoder(Encoder):
    """The encoder of a plug-in, on one device."""

    def __init__(self, plugin: Plugin, device: str = "cpu") -> None:
        record: EncoderPlugin = plugin.record
        self.plugin, self.config, self._device = plugin, record, torch.device(device)  # pyright: ignore
        self.about = {"path": str(plugin.file), "name": record.name, "about": record.about, **plugin.as_data()}
        self.model: Any = record.make(self._device)

    @property
    def identity(self) -> str:
        """Name and version, by which policies know the encoder of their codes."""
        return f"{self.plugin.name} {self.plugin.record.version}"

    @property
    def vae(self) -> VAE:
        raise EncoderInputError(f"the encoder {self.plugin.name} of a plug-in has no decoder: its codes are no images")

    def of_tensor(self, frames: Tensor) -> Tensor:
        """Return codes float32 [N, Z] of a tensor of frames uint8 [N, H, W, C], on the encoder's device.

        Raises `EncoderInputError` for other frames, and if the plug-in returns anything else.
        """
        self._check(tuple(frames.shape), frames.dtype)
        channels = self.config.channels
        if frames.shape[3] != len(channels):
            frames = frames[..., channels[0] : channels[-1] + 1]
        with torch.inference_mode():
            codes = self.model(frames.to(self._device))
        if not isinstance(codes, Tensor) or codes.shape != (len(frames), self.latent) or codes.dtype != torch.float32:
            found = f"{codes.dtype} {list(codes.shape)}" if isinstance(codes, Tensor) else type(codes).__name__
            raise EncoderInputError(
                f"the encoder {self.plugin.name} ({self.plugin.place}) must return float32 [{len(frames)},"
                f" {self.latent}] for {len(frames)} frames, not {found}"
            )
        return codes


def encoder_plugin(name: str) -> Plugin | None:
    """Return the plug-in of the encoder with a name; None for one of the package, or none at all."""
    return find(GROUP, name, PACKAGED)


def encoder_size(name: str) -> tuple[int, int]:
    """Return height and width of the frames that the encoder of a name takes, one of `encoder_names`."""
    plugin = encoder_plugin(name)
    return frame_size_of(PACKAGED[name]) if plugin is None else sides(plugin.record.size_px)
