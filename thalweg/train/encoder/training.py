"""Collection of frames and training of an encoder on them.

Collecting takes minutes, so all settings are checked before the first frame.
"""

from dataclasses import asdict
from pathlib import Path

from thalweg.encoder import EncoderFileError, EncoderInputError, Source, TrainingResult, VAEConfig, train_encoder
from thalweg.encoder.files import read_tensors
from thalweg.render import RENDER_VERSION
from thalweg.train.encoder import frames as collect
from thalweg.world import level_named

CHECKPOINT = "checkpoint.safetensors"


def collect_and_train(
    folder: Path,
    config: VAEConfig,
    *,
    level: str = "Medium",
    images: int = 2000,
    held_out: int = 200,
    epochs: int = 100,
    seed: int = 0,
    command: str = "",
) -> TrainingResult:
    """Train on `images` frames of a level and measure on `held_out` further ones; the same call resumes.

    `command` is written into the encoder's file. Raises `EncoderInputError`, `EncoderFileError` or `WorldError`, before
    a frame is drawn, for settings that make no sense, a folder of another training and an unknown level.
    """
    if epochs < 1:
        raise EncoderInputError(f"epochs must be at least 1, not {epochs}")
    if seed < 0:
        raise EncoderInputError(f"seed must be 0 or more, not {seed}")
    if held_out < 0 or images < 2:
        raise EncoderInputError(f"of {images + held_out} images, {held_out} can't be held out: at least 2 must be left")
    name = level_named(level).name
    known = {
        "config": asdict(config),
        "epochs": epochs,
        "seed": seed,
        "held_out": held_out,
        "images": images + held_out,
    }
    _check_folder(folder, known)
    frames = collect.collect_frames(images + held_out, level=name, seed=seed)
    source = Source(name, seed, RENDER_VERSION, command)
    return train_encoder(frames, config, folder, epochs=epochs, seed=seed, held_out=held_out, source=source)


def _check_folder(folder: Path, known: dict[str, object]) -> None:
    """Raise `EncoderFileError` if the folder is none, or holds a training that differs in what is known of this one."""
    if folder.exists() and not folder.is_dir():
        raise EncoderFileError(f"{folder} is not a folder")
    path = folder / CHECKPOINT
    if not path.exists():
        return
    _, about = read_tensors(path, "encoder training")
    for name, mine in known.items():
        found = about.get("run", {}).get(name)
        if found != mine:
            raise EncoderFileError(f"{path}: a training with {name} {found}, not {mine}; choose another folder")
