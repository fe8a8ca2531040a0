"""Training of an encoder on frames of a level.

Collecting frames takes minutes, so that all settings are checked before the first frame is rendered.
"""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from thalweg.core import versions
from thalweg.core.config import to_plain
from thalweg.core.seeds import compact_seeds, parse_seeds, refuse_unseen
from thalweg.encoder import EncoderInputError, Source, TrainingResult, VAEConfig, train_encoder
from thalweg.encoder.checkpoint import check_folder
from thalweg.encoder.training import ENCODER_FOLDER, finished_training, resolve_precision
from thalweg.render import RENDER_VERSION
from thalweg.train.encoder import frames as frame_collection
from thalweg.train.encoder.drawing import Drawing
from thalweg.train.encoder_of_run import check_size_fits
from thalweg.train.river import banks_version
from thalweg.world import Reach, level_named


def collect_and_train(
    folder: Path,
    config: VAEConfig,
    *,
    level: str | Reach = "Medium",
    world_seeds: Any = (),
    images: int = 2000,
    held_out: int = 200,
    epochs: int = 100,
    seed: int = 0,
    drawing: Drawing | None = None,
    command: str = "",
) -> TrainingResult:
    """Train on `images` frames of a level or a real river, and evaluate on `held_out` further ones.

    The same call resumes; a finished training is read, and nothing is drawn.

    `world_seeds` are those of the rivers, by default the level's fixed one; see `collect_frames`. `drawing` is how the
    frames are drawn, of the size in `config`. `command` is stored in the encoder's file. Before a frame is rendered,
    raises `EncoderInputError` for settings out of range, `EncoderFileError` for a folder of another training or one
    that another process is at, `OSError` for one that cannot be written, and `WorldError` for an unknown level.
    """
    _check_numbers(epochs, seed, images, held_out)
    if isinstance(level, Reach):
        level.check()
        name = level.name
    else:
        name = level = level_named(level).name
    seeds = parse_seeds(world_seeds, "world_seeds", EncoderInputError)
    if not isinstance(level, Reach):
        refuse_unseen(seeds, "world_seeds", EncoderInputError)
    if len(seeds) > images + held_out:
        raise EncoderInputError(f"{images + held_out} images of {len(seeds)} rivers: there must be one image of each")
    drawing = drawing or Drawing()
    check_size_fits(drawing.camera, config.size_px, "that is trained", EncoderInputError)
    run = {
        "config": to_plain(config),
        "epochs": epochs,
        "seed": seed,
        "held_out": held_out,
        "images": images + held_out,
        "encoder_version": versions.ENCODER,
        **(identity := _identity(level, seeds, drawing)),
    }
    check_folder(folder, ENCODER_FOLDER, run)
    if (found := finished_training(folder, epochs)) is not None:
        return found
    check_folder(folder, ENCODER_FOLDER, {**run, "precision": resolve_precision("auto")})
    collect = partial(
        frame_collection.collect_frames,
        images + held_out,
        level=level,
        seed=seed,
        world_seeds=seeds,
        camera=drawing.camera,
        quality=drawing.quality,
        randomisation=drawing.randomisation,
    )
    source = Source(name, seed, RENDER_VERSION, command, tuple(compact_seeds(seeds)))
    return train_encoder(
        collect,  # once the folder is held
        config,
        folder,
        epochs=epochs,
        seed=seed,
        held_out=held_out,
        source=source,
        identity=identity,
    )


def _check_numbers(epochs: int, seed: int, images: int, held_out: int) -> None:
    """Raise `EncoderInputError` for a number out of range."""
    if epochs < 1:
        raise EncoderInputError(f"epochs must be at least 1, not {epochs}")
    if seed < 0:
        raise EncoderInputError(f"seed must be 0 or more, not {seed}")
    if held_out < 0 or images < 2:
        raise EncoderInputError(f"of {images + held_out} images, {held_out} can't be held out: at least 2 must be left")


def _identity(ground: str | Reach, seeds: Sequence[int], drawing: Drawing) -> dict[str, Any]:
    """Return what distinguishes the frames from others: their river, how they are drawn, and the versions of both."""
    of_file = isinstance(ground, Reach)
    rivers: dict[str, Any] = {"river": ground.as_data()} if of_file else {"level": ground}
    rivers |= {"world_seeds": compact_seeds(seeds)} if seeds else {}
    rivers |= banks_version([ground if of_file else level_named(ground)])
    return {**rivers, "render_version": RENDER_VERSION, "world_version": versions.WORLD, **drawing.as_data()}
