"""Encoder files: one safetensors file with the tensors and a JSON text that describes them.

Loading one can't execute code. Files are written atomically. The provenance of a file (images, level,
seeds, errors, the command) is stored in the JSON and never enters a computation.
"""

import json
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

import torch
from safetensors import safe_open
from safetensors.torch import save as serialize

from thalweg.core.atomic_io import write_atomic
from thalweg.core.config import parse_config, to_plain
from thalweg.encoder.frame_size import sides
from thalweg.encoder.geometry import GeometryConfig, GeometryNetwork
from thalweg.encoder.vae import VAE, EncoderInputError, VAEConfig

FORMAT = 1
"""Version of the file format: a file of another version is refused."""
FILE = "encoder.safetensors"
"""Name of the file in the folder of a run that trains an encoder."""
KEY = "thalweg"
"""Key of the JSON text in the metadata of a safetensors file; a single key keeps the bytes deterministic."""

AUTOENCODER, GEOMETRY = "encoder", "geometry encoder"
"""Kinds of files that hold an encoder."""
MODELS: dict[str, tuple[Any, Any]] = {AUTOENCODER: (VAE, VAEConfig), GEOMETRY: (GeometryNetwork, GeometryConfig)}
"""Model and configuration of each kind."""
MAX_NUMBER = 1e9
"""Largest number in a tensor; far larger ones would overflow in codes."""
C = TypeVar("C", VAEConfig, GeometryConfig)


class EncoderFileError(ValueError):
    """Error for a file that is not an encoder, is damaged or does not fit; the message names path and reason."""


def write_tensors(path: str | Path, tensors: Mapping[str, torch.Tensor], about: Mapping[str, Any]) -> None:
    """Write tensors and their JSON description `about` to `path`, atomically."""
    plain = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    write_atomic(path, serialize(plain, {KEY: json.dumps(about, sort_keys=True)}))


def read_tensors(path: str | Path, kind: str, *others: str) -> tuple[dict[str, torch.Tensor], dict[str, Any]]:
    """Return the tensors and JSON of a file of the given kind, or one of the others; raises `EncoderFileError` for any
    other file, which names the first kind."""
    path = Path(path)
    if not path.is_file():
        raise EncoderFileError(f"{path}: no such file")
    try:
        with safe_open(path, framework="pt") as file:
            text = (file.metadata() or {}).get(KEY)
            about = json.loads(text) if text else None
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (a file, not a dict)
    except Exception as error:  # also for types of numbers that this PyTorch lacks, and for JSON nested too deep
        raise EncoderFileError(f"{path}: truncated, damaged or not a safetensors file ({error})") from error
    if not isinstance(about, dict) or about.get("kind") not in (kind, *others):
        found = about.get("kind") if isinstance(about, dict) else None
        raise EncoderFileError(f"{path}: a safetensors file, but no {kind} of Thalweg (its kind: {found})")
    if about.get("format") != FORMAT:
        raise EncoderFileError(f"{path}: format {about.get('format')}, but this Thalweg reads format {FORMAT}")
    return tensors, about


def frame_size_of(path: str | Path) -> tuple[int, int]:
    """Return height and width of the frames that the encoder of an intact file takes, without loading its tensors."""
    with safe_open(path, framework="pt") as file:
        return sides(json.loads(file.metadata()[KEY])["config"]["size_px"])


def save_vae(path: str | Path, vae: VAE, about: Mapping[str, Any], *, half_decoder: bool = True) -> None:
    """Write an autoencoder and its description `about`.

    `half_decoder` stores the decoder, which only draws images, in float16, except tensors with values too large for it.
    """
    tensors = {}
    for name, tensor in vae.state_dict().items():
        decodes = name.startswith(("decoder.", "expand."))
        small = half_decoder and decodes and tensor.is_floating_point() and bool(tensor.half().isfinite().all())
        tensors[name] = tensor.half() if small else tensor
    write_tensors(path, tensors, {**about, "kind": AUTOENCODER, "format": FORMAT, "config": to_plain(vae.config)})


def load_vae(path: str | Path) -> tuple[VAE, dict[str, Any]]:
    """Return the autoencoder of a file, in float32 and evaluation mode, and its JSON; raises `EncoderFileError`."""
    return _loaded(path, *read_tensors(path, AUTOENCODER))


def save_geometry(path: str | Path, network: GeometryNetwork, about: Mapping[str, Any]) -> None:
    """Write an encoder of geometry and its description `about`."""
    described = {**about, "kind": GEOMETRY, "format": FORMAT, "config": to_plain(network.config)}
    write_tensors(path, network.state_dict(), described)


def load_model(path: str | Path) -> tuple[VAE | GeometryNetwork, dict[str, Any]]:
    """Return the autoencoder or the encoder of geometry of a file, in evaluation mode, and its JSON.

    Raises `EncoderFileError` for any other file.
    """
    return _loaded(path, *read_tensors(path, *MODELS))


def _loaded(path: str | Path, tensors: Mapping[str, torch.Tensor], about: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
    """Return the model of a file's tensors and JSON, with the latter; raises `EncoderFileError`."""
    network, kind = MODELS[about["kind"]]
    config = config_of(path, about, kind)
    try:
        with torch.device("meta"):  # without memory: a wrong size must not fill it before the shapes are compared
            expected = {name: tuple(tensor.shape) for name, tensor in network(config).state_dict().items()}
    except (RuntimeError, TypeError, ValueError, OverflowError) as error:
        raise EncoderFileError(f"{path}: bad configuration: {error}") from error
    found = {name: tuple(tensor.shape) for name, tensor in tensors.items()}
    for name in sorted(expected.keys() | found.keys()):
        if expected.get(name) != found.get(name):
            raise EncoderFileError(f"{path}: tensor {name} has shape {found.get(name)}, not {expected.get(name)}")
        if wrong := _number_error(name, tensors[name]):
            raise EncoderFileError(f"{path}: tensor {name} holds numbers that are {wrong}")
    with torch.random.fork_rng(devices=[]):  # its initial weights, of no use, are not drawn from the caller's numbers
        model = network(config)
    model.load_state_dict({name: tensor.to(model.state_dict()[name].dtype) for name, tensor in tensors.items()})
    return model.eval(), about


def _number_error(name: str, tensor: torch.Tensor) -> str:
    """Return what is wrong with the numbers of a tensor; empty for nothing."""
    if tensor.dtype not in (torch.float16, torch.bfloat16, torch.float32, torch.float64, torch.int64):
        return str(tensor.dtype).removeprefix("torch.")
    if not torch.isfinite(tensor).all():
        return "not finite"
    if (tensor.abs() > MAX_NUMBER).any():
        return f"larger than {MAX_NUMBER:g}"
    if name.endswith("running_var") and (tensor < 0).any():
        return "negative, but variances"
    return ""


def encoder_file(path: str | Path) -> Path:
    """Return the encoder's file in the folder of a run that trained one, or the path of a file itself.

    Raises `EncoderFileError` for a folder without one.
    """
    path = Path(path)
    if path.is_dir() and not (path / FILE).is_file():
        raise EncoderFileError(
            f"{path}: a folder without {FILE}, which `thalweg encoder train` writes when it ends; give such a folder,"
            " or an encoder's file"
        )
    return path / FILE if path.is_dir() else path


def config_of(path: str | Path, about: Mapping[str, Any], kind: type[C]) -> C:
    """Return the configuration in a file's JSON; raises `EncoderFileError` for unknown, missing or bad values."""
    found = about.get("config")
    known = {field.name for field in fields(kind)}  # pyright: ignore[reportArgumentType]
    if not isinstance(found, dict) or set(found) != known:
        names = ", ".join(sorted(found)) if isinstance(found, dict) else found
        raise EncoderFileError(f"{path}: the configuration has {names}, not {', '.join(sorted(known))}")
    try:
        return parse_config(kind, found)
    except EncoderInputError as error:
        raise EncoderFileError(f"{path}: bad configuration: {error}") from error
