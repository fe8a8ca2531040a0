"""Encoder files: one safetensors file with the tensors and a JSON text that describes them.

Loading one can't execute code. Files are written atomically. The provenance of a file (images, level,
seeds, errors, the command) is stored in the JSON and never enters a computation.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save as serialize

from thalweg.core.atomic_io import write_atomic
from thalweg.core.config import parse_config
from thalweg.encoder.vae import VAE, EncoderInputError, VAEConfig

FORMAT = 1
"""Version of the file format: a file of another version is refused."""
FILE = "encoder.safetensors"
"""Name of the file in the folder of a run that trains an encoder."""
KEY = "thalweg"
"""Key of the JSON text in the metadata of a safetensors file; a single key keeps the bytes deterministic."""


class EncoderFileError(ValueError):
    """Error for a file that is not an encoder, is damaged or does not fit; the message names path and reason."""


def write_tensors(path: str | Path, tensors: Mapping[str, torch.Tensor], about: Mapping[str, Any]) -> None:
    """Write tensors and their JSON description `about` to `path`, atomically."""
    plain = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    write_atomic(path, serialize(plain, {KEY: json.dumps(about, sort_keys=True)}))


def read_tensors(path: str | Path, kind: str) -> tuple[dict[str, torch.Tensor], dict[str, Any]]:
    """Return the tensors and JSON of a file of the given kind; raises `EncoderFileError` for any other file."""
    path = Path(path)
    if not path.is_file():
        raise EncoderFileError(f"{path}: no such file")
    try:
        with safe_open(path, framework="pt") as file:
            text = (file.metadata() or {}).get(KEY)
            about = json.loads(text) if text else None
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (a file, not a dict)
    except (SafetensorError, json.JSONDecodeError, OSError) as error:
        raise EncoderFileError(f"{path}: truncated, damaged or not a safetensors file ({error})") from error
    if not isinstance(about, dict) or about.get("kind") != kind:
        found = about.get("kind") if isinstance(about, dict) else None
        raise EncoderFileError(f"{path}: a safetensors file, but no {kind} of Thalweg (its kind: {found})")
    if about.get("format") != FORMAT:
        raise EncoderFileError(f"{path}: format {about.get('format')}, but this Thalweg reads format {FORMAT}")
    return tensors, about


def save_vae(path: str | Path, vae: VAE, about: Mapping[str, Any], *, half_decoder: bool = True) -> None:
    """Write an autoencoder and its description `about`.

    `half_decoder` stores the decoder, which only draws images, in float16, except tensors with values too large for it.
    """
    tensors = {}
    for name, tensor in vae.state_dict().items():
        decodes = name.startswith(("decoder.", "expand."))
        small = half_decoder and decodes and tensor.is_floating_point() and bool(tensor.half().isfinite().all())
        tensors[name] = tensor.half() if small else tensor
    write_tensors(path, tensors, {**about, "kind": "encoder", "format": FORMAT, "config": asdict(vae.config)})


def load_vae(path: str | Path) -> tuple[VAE, dict[str, Any]]:
    """Return the autoencoder of a file, in float32 and evaluation mode, and its JSON; raises `EncoderFileError`."""
    tensors, about = read_tensors(path, "encoder")
    vae = VAE(config_of(path, about))
    expected = {name: tuple(tensor.shape) for name, tensor in vae.state_dict().items()}
    found = {name: tuple(tensor.shape) for name, tensor in tensors.items()}
    for name in sorted(expected.keys() | found.keys()):
        if expected.get(name) != found.get(name):
            raise EncoderFileError(f"{path}: tensor {name} has shape {found.get(name)}, not {expected.get(name)}")
        if not torch.isfinite(tensors[name]).all():
            raise EncoderFileError(f"{path}: tensor {name} holds numbers that are not finite")
    vae.load_state_dict({name: tensor.to(vae.state_dict()[name].dtype) for name, tensor in tensors.items()})
    return vae.eval(), about


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


def config_of(path: str | Path, about: Mapping[str, Any]) -> VAEConfig:
    """Return the configuration in a file's JSON; raises `EncoderFileError` for unknown, missing or bad values."""
    found = about.get("config")
    known = {field.name for field in fields(VAEConfig)}
    if not isinstance(found, dict) or set(found) != known:
        names = ", ".join(sorted(found)) if isinstance(found, dict) else found
        raise EncoderFileError(f"{path}: the configuration has {names}, not {', '.join(sorted(known))}")
    try:
        return parse_config(VAEConfig, found)
    except EncoderInputError as error:
        raise EncoderFileError(f"{path}: bad configuration: {error}") from error
