"""Frozen encoder from frames to codes: fast inference that is bit-identical for any batch.

Batch norms are folded into the convolutions and the division by 255 into the first of them, which leaves six
convolutions and one linear layer, or two of an encoder of geometry. float32 is the default although bfloat16 is 1.5
times as fast: codes then agree between machines with and without bfloat16. The model is not compiled, since that would
take more time than it saves. The first layers of an encoder of masks are computed only where a mask is not uniform, see
`mask_layers`.

A frame gives the same bits in a batch of any size and content. Two cases sum in another order and would break that: a
convolution of a single image, which is therefore encoded together with a copy of itself, and a linear layer of few
rows, which therefore always gets a multiple of 16. The tests verify this in float32 on the CPU that runs them; between
CPUs, codes agree within 1e-4.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from thalweg.core.compute.device import resolve_device
from thalweg.core.compute.torch_layers import uninitialised
from thalweg.core.compute.torch_threads import run_in_torch_threads
from thalweg.core.plugins.lookup import names
from thalweg.core.suggestion import did_you_mean
from thalweg.encoder.files import EncoderFileError, encoder_file, load_model
from thalweg.encoder.frame_size import halved, sides
from thalweg.encoder.geometry import GeometryNetwork
from thalweg.encoder.leaky_convolution import LeakyConvolution
from thalweg.encoder.mask_layers import SPARSE_STEP, encode_masks, mask_layers, output_shape
from thalweg.encoder.vae import VAE, EncoderInputError

DEFAULT_PATH = Path(__file__).with_name("default.safetensors")
"""The autoencoder that comes with the package, whose encoder is used by default."""
GROUP = "thalweg.encoders"
"""Group of the entry points of encoders."""
PACKAGED = {
    "default": DEFAULT_PATH,
    "geometry": Path(__file__).with_name("geometry.safetensors"),
    "geometry-tasks": Path(__file__).with_name("geometry-tasks.safetensors"),
}
"""Files of the encoders that come with the package, by their names: `geometry` was trained to predict the ideal eye,
and `geometry-tasks` also what a camera can tell of tasks."""
Model = VAE | GeometryNetwork
"""What has convolutions that are its `encoder`, and `dense_layers` behind them that give the code."""
ROWS = 16
"""The rows of the linear layer are padded with zeros to a multiple of this number."""
CHUNKS = {"cpu": 64, "cuda": 1024}
"""Frames per batch on each device, which bounds the memory that many frames need."""
LEAST_FRAMES = 4
"""Least frames for each thread: fewer are encoded sooner by one."""
PRECISIONS = {"float32": torch.float32, "bfloat16": torch.bfloat16}


class Encoder:
    """Frames uint8 [N, H, W, C] to codes float32 [N, Z], on one device, without gradients.

    The code of an autoencoder is the mean of its Gaussian. C is the number of channels of `inputs`, or 4, of which the
    channels of `inputs` are selected.
    """

    def __init__(self, model: Model, about: Mapping[str, Any] | None = None, *, precision="float32", device="cpu"):
        if precision not in PRECISIONS:
            raise EncoderInputError(f"unknown precision {precision!r}; known: {', '.join(PRECISIONS)}")
        self.model = model.cpu().eval()
        self.config = model.config
        self.about = dict(about or {})
        self._device = torch.device(device)
        self._dtype = PRECISIONS[precision]
        convolutions, self._head = fold_batch_norms(model)
        for layer in convolutions:
            layer.to(self._device, self._dtype, memory_format=torch.channels_last)  # pyright: ignore
        sparse = self.inputs == "mask" and self._device.type == "cpu" and self._dtype == torch.float32
        sparse = sparse and not any(side % SPARSE_STEP for side in sides(self.config.size_px))
        self._mask_layers = mask_layers(convolutions, sides(self.config.size_px)) if sparse else ()
        self._convolutions = nn.Sequential(
            *(
                LeakyConvolution(layer, halved(self.config.size_px, depth))
                for depth, layer in enumerate(convolutions)
                if depth >= len(self._mask_layers)
            )
        )
        self._head.to(self._device, self._dtype)

    @property
    def device(self) -> torch.device:
        """Device of the computation."""
        return self._device

    @property
    def latent(self) -> int:
        """Numbers in a code, Z."""
        return self.config.latent

    @property
    def inputs(self) -> str:
        """Channels that are encoded: "rgb", "mask" or "rgb+mask"."""
        return self.config.inputs

    @property
    def vae(self) -> VAE:
        """The autoencoder; raises `EncoderInputError` for an encoder of geometry, which is none."""
        if not isinstance(self.model, VAE):
            raise EncoderInputError("an encoder of geometry has no decoder: its codes are no images")
        return self.model

    @property
    def render_version(self) -> int | None:
        """Version of the renderer whose frames it was trained on; None if the file does not contain it."""
        return self.about.get("render_version")

    def __call__(self, frames: np.ndarray) -> np.ndarray:
        """Return codes float32 [N, Z] of frames uint8 [N, H, W, C]; raises `EncoderInputError` for anything else."""
        self._check(np.shape(frames), getattr(frames, "dtype", None))
        return self.of_tensor(torch.from_numpy(np.ascontiguousarray(frames))).cpu().numpy()

    def of_tensor(self, frames: Tensor) -> Tensor:
        """Return codes float32 [N, Z] of a tensor of frames uint8 [N, H, W, C], on the encoder's device."""
        self._check(tuple(frames.shape), frames.dtype)
        channels, chunk = self.config.channels, CHUNKS.get(self._device.type, CHUNKS["cuda"])
        if frames.shape[3] != len(channels):
            frames = frames[..., channels[0] : channels[-1] + 1]
        codes = torch.empty(len(frames), self.latent, dtype=torch.float32, device=self._device)

        def encode(first: int, last: int) -> None:
            with torch.inference_mode():
                for start in range(first, last, chunk):
                    end = min(start + chunk, last)
                    codes[start:end] = self._codes_of(frames[start:end])

        if self._device.type == "cpu":
            # PyTorch's own threads wait for their next task in a loop that takes cores from the renderer.
            run_in_torch_threads(len(frames), encode, LEAST_FRAMES)
        else:
            encode(0, len(frames))
        return codes

    def _codes_of(self, frames: Tensor) -> Tensor:
        """Return codes float32 [K, Z] of at most a chunk of frames."""
        padded_frames = frames.repeat(2, 1, 1, 1) if len(frames) == 1 else frames
        features = self._convolutions(self._inputs_of(padded_frames)).flatten(1)
        return self._linear(features)[: len(frames)].float()

    def _inputs_of(self, frames: Tensor) -> Tensor:
        """Return what the dense convolutions take, [K, C, H, W]: the frames, or the first features of masks."""
        if self._mask_layers:
            masks = np.ascontiguousarray(frames[..., 0].cpu().numpy())
            features = np.empty((len(masks), *output_shape(self._mask_layers)), np.float32)
            encode_masks(masks, self._mask_layers, features)
            return torch.from_numpy(features).permute(0, 3, 1, 2)
        # Converting after the cut keeps the big tensor uint8; H, W, C in memory is what "channels last" means.
        return frames.to(self._device).to(self._dtype).permute(0, 3, 1, 2)

    def decode(self, codes: np.ndarray) -> np.ndarray:
        """Return reconstructed frames uint8 [N, H, W, C] from codes [N, Z]; C is the number of channels of `inputs`.

        Raises `EncoderInputError` for codes of another shape, and for an encoder of geometry.
        """
        vae = self.vae
        if codes.ndim != 2 or codes.shape[1] != self.latent:
            raise EncoderInputError(f"codes must have the shape [N, {self.latent}], not {list(codes.shape)}")
        with torch.inference_mode():
            images = vae.decode(torch.as_tensor(codes, dtype=torch.float32))
        return (images.permute(0, 2, 3, 1) * 255).round().to(torch.uint8).numpy()

    def predict(self, codes: np.ndarray) -> np.ndarray:
        """Return the quantities float32 [N, T], `config.targets` in their units, that an encoder of geometry reads from
        codes [N, Z]; raises `EncoderInputError` for any other encoder."""
        if not isinstance(self.model, GeometryNetwork):
            raise EncoderInputError("only an encoder of geometry predicts quantities; this is an autoencoder")
        with torch.inference_mode():
            return self.model.predict(torch.as_tensor(codes, dtype=torch.float32)).numpy()

    def _check(self, shape: tuple[int, ...], dtype: Any) -> None:
        (height, width), channels = sides(self.config.size_px), self.config.channels
        if len(shape) == 4 and shape[1:3] != (height, width):
            raise EncoderInputError(
                f"this encoder takes frames of {height} x {width} pixels, not of {shape[1]} x {shape[2]} (height x"
                f" width): give the camera height_px={height} and width_px={width}, or use another encoder"
            )
        if len(shape) != 4 or shape[3] not in (len(channels), 4):
            counts = " or ".join(f"[N, {height}, {width}, {count}]" for count in dict.fromkeys((len(channels), 4)))
            raise EncoderInputError(f"an encoder of {self.inputs} takes frames {counts}, not {list(shape)}")
        if dtype not in (np.uint8, torch.uint8):
            raise EncoderInputError(f"frames must be uint8, not {dtype}")

    def _linear(self, features: Tensor) -> Tensor:
        missing = -len(features) % ROWS
        padded = nn.functional.pad(features, (0, 0, 0, missing)) if missing else features
        return self._head(padded)[: len(features)]


@torch.no_grad()
def fold_batch_norms(model: Model) -> tuple[list[nn.Conv2d], nn.Module]:
    """Return the convolutions with folded batch norms, for pixels in 0..255, and the layers behind them.

    With γ, β the norm's scale and shift, m, v its running mean and variance:
    γ (Wx − m) / √(v + ε) + β = (γ/√(v + ε)) W x + β − γ m/√(v + ε). The first W also takes the division by 255.
    """
    convolutions = []
    layers = list(model.encoder)
    for convolution, norm in zip(layers[0::3], layers[1::3], strict=True):
        assert isinstance(convolution, nn.Conv2d) and isinstance(norm, nn.BatchNorm2d)
        assert norm.running_mean is not None and norm.running_var is not None
        scale = norm.weight.double() / torch.sqrt(norm.running_var.double() + norm.eps)
        weight = convolution.weight.double() * scale[:, None, None, None]
        shift = norm.bias.double() - scale * norm.running_mean.double()
        convolutions.append(_convolution(weight if convolutions else weight / 255, shift))
    return convolutions, model.dense_layers()


def load_encoder(
    path: str | Path | None = None, *, latent: int | None = None, precision: str = "float32", device: str = "cpu"
) -> Encoder:
    """Load the encoder of a file, of the folder of a run that trained it, or one of `PACKAGED` by its name.

    The default is the autoencoder of the package; `latent` is the required code size, if any.

    Raises `EncoderFileError` for a file that is missing, truncated, foreign, of another version or code size, and
    `DeviceError` for an unusable device.
    """
    path, device = encoder_path(path), resolve_device(device)
    model, about = load_model(path)
    if latent is not None and model.config.latent != latent:
        raise EncoderFileError(f"{path}: encodes to {model.config.latent} numbers, but {latent} are needed")
    return Encoder(model, {**about, "path": str(path)}, precision=precision, device=device)


def encoder_names() -> list[str]:
    """Return the names of all encoders, those of plug-ins last."""
    return [*PACKAGED, *(name for name in names(GROUP) if name not in PACKAGED)]


def encoder_path(given: str | Path | None) -> Path:
    """Return the path of an encoder's file, given by itself, by the folder of its run or by a name of `PACKAGED`.

    None is the default of the package. Raises `EncoderFileError` for what is none of these.
    """
    path = DEFAULT_PATH if given is None else PACKAGED.get(str(given), Path(given))
    if not path.exists():
        known = encoder_names()
        raise EncoderFileError(
            f"{path}: no such file{did_you_mean(str(given), known)}; give an encoder's file, the folder of"
            f" `thalweg encoder train`, or one of: {', '.join(known)}"
        )
    return encoder_file(path)


def check_render_version(encoder: Encoder, version: int) -> None:
    """Raise `EncoderFileError` unless the encoder was trained on frames of this version of the renderer."""
    if encoder.render_version != version:
        raise EncoderFileError(
            f"{encoder.about.get('path', 'the encoder')}: trained on frames of renderer version"
            f" {encoder.render_version}, but the renderer is version {version}; train it anew"
        )


def _convolution(weight: torch.Tensor, bias: torch.Tensor) -> nn.Conv2d:
    out_channels, in_channels, height, width = weight.shape
    layer = uninitialised(nn.Conv2d, in_channels, out_channels, (height, width), 2, 1).requires_grad_(False)
    layer.weight.copy_(weight)
    assert layer.bias is not None
    layer.bias.copy_(bias)
    return layer
