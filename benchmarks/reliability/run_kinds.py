"""Kinds of files of runs that resume, of plug-ins and of exported policies: settings, logs, checkpoints of encoders."""

import functools
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
import yaml
from kind import Kind, written
from mutations import mutated_bytes, mutated_lines, mutated_safetensors, mutated_table, mutated_yaml

from tests.encoder.test_geometry import CONFIG, Synthetic
from thalweg.core.plugins.loading import object_named, plugins_in
from thalweg.core.plugins.record import PluginError
from thalweg.encoder import EncoderFileError, EncoderInputError
from thalweg.encoder.geometry_training import CHECKPOINT, train_geometry
from thalweg.encoder.training import train_encoder
from thalweg.encoder.vae import VAEConfig
from thalweg.encoder.water import WaterSegmenter, load_segmenter, save_segmenter, water_in
from thalweg.render.bake import array_files
from thalweg.render.bake.baked_maps import MOST_BYTES, BakedMaps
from thalweg.train.errors import TrainingError
from thalweg.train.folder.loggers import CsvTable
from thalweg.train.folder.run_record import read_context
from thalweg.train.run_in_folder import open_folder

REPOSITORY = Path(__file__).resolve().parents[2]
RUN = REPOSITORY / "tests" / "saved_files" / "written_by_0_1_0" / "run"
FRAMES = np.random.default_rng(0).integers(256, size=(8, 64, 64, 4), dtype=np.uint8)
LESSONS = Synthetic(16)
VAE = VAEConfig(inputs="mask", latent=2, size_px=64)


def _resume_run(path: Path) -> Any:
    """Return what of the run's settings is read before it resumes."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of other versions, and of sources that have changed
        status = open_folder(path.parent, yaml.safe_load((RUN / "config.yaml").read_text())["run"], threads=1)
    return status, read_context(path.parent)


def _resume_table(content: bytes) -> Callable[[Path], Any]:
    """Return a reader that appends a row to a table of which a checkpoint has as many bytes as the content."""

    def read(path: Path) -> Any:
        table = CsvTable(path, len(content))
        table.write({"steps": 1, "return_mean": 0.5})
        return table.sync() and table.close()

    return read


def _table(name: str) -> Kind:
    content = (RUN / name).read_bytes()
    return Kind(name, lambda _: [content], mutated_table, _resume_table(content), (TrainingError,))


def _encoder_checkpoint(folder: Path) -> list[bytes]:
    return [written(folder, CHECKPOINT, lambda path: _train_encoder(path.parent))]


def _train_encoder(folder: Path) -> Any:
    found = train_encoder(FRAMES, VAE, folder, epochs=1, batch=4, precision="float32", progress=False)
    return found.train_mse


def _geometry_checkpoint(folder: Path) -> list[bytes]:
    return [written(folder, CHECKPOINT, lambda path: _train_geometry(path.parent))]


def _train_geometry(folder: Path) -> Any:
    network = train_geometry(LESSONS, CONFIG, folder, epochs=1, precision="float32", progress=False)
    return [value.numpy() for value in network.state_dict().values()]


def _segmenters(folder: Path) -> list[bytes]:
    torch.manual_seed(0)
    about = {"held_out_iou": 0.5}
    return [written(folder, "a.safetensors", lambda path: save_segmenter(path, WaterSegmenter().eval(), about))]


def _read_segmenter(path: Path) -> Any:
    return water_in(load_segmenter(path), FRAMES[:1, :32, :32])


def _maps(folder: Path) -> list[bytes]:
    maps = BakedMaps(*(np.arange(24, dtype=np.float32).reshape(2, 3, 4) for _ in BakedMaps._fields))
    return [written(folder, "a.npz", lambda path: array_files.store(maps, path, MOST_BYTES))]


def _read_maps(path: Path) -> Any:
    """Return the maps, or None: a damaged file of the cache is made again."""
    return array_files.stored(path, BakedMaps._fields)


PLUGIN = b'''"""A section of reports, and a function that flies."""

from thalweg.bench.report.plugins import SectionPlugin
from thalweg.bench.report.sections import TableSection
from thalweg.bench.report.table import table_from_cells

SHARE = 0.5


def longest(results):
    """Return the steps of the longest flights."""
    return table_from_cells(["policy", "steps"], [[row.algorithm, row.length] for row in results.episodes])


def fly(frames):
    """Return the same move for each vehicle."""
    return [[1, 1, 2, 1] for _ in frames]


PLUGIN = SectionPlugin(TableSection("longest", "Longest flights", longest), version=1, after="table")
'''


def _read_plugin(path: Path) -> Any:
    """Return name and version of the plug-ins, and the name of the function."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # SyntaxWarning
        plugins = [(plugin.name, plugin.record.version) for plugin in plugins_in(path)]
        return plugins, str(object_named(f"{path}:fly")[0])


@functools.cache
def _exported() -> bytes:
    """Return a small exported policy."""
    import tempfile

    from tests.deploy.policies import of_images
    from thalweg.deploy.export import export_policy

    with tempfile.TemporaryDirectory() as folder:
        export_policy(of_images("mask"), Path(folder) / "a.onnx")
        return (Path(folder) / "a.onnx").read_bytes()


def _read_onnx(path: Path) -> Any:
    """Return the action of a policy."""
    from thalweg.deploy.onnx_policy import OnnxPolicy

    player = OnnxPolicy.load(path).player(1)
    return player(mask=np.zeros((1, 128, 128), np.uint8))


def _mutated_onnx(content: bytes, random: Any) -> bytes:
    """Return an exported policy with its description mutated, which has the same length, or with other bytes."""
    begin, end = content.find(b'{"'), content.rfind(b"}") + 1
    if random.random() < 0.5 or begin < 0:
        return mutated_bytes(content, random)
    text = mutated_bytes(content[begin:end], random)[: end - begin]
    return content[:begin] + text.ljust(end - begin) + content[end:]


def _deploy_errors() -> tuple[type[Exception], ...]:
    from thalweg.deploy.errors import ExportError

    return (ExportError,)


RUN_KINDS: dict[str, Kind] = {
    "run settings": Kind(
        "config.yaml", lambda _: [(RUN / "config.yaml").read_bytes()], mutated_yaml, _resume_run, (TrainingError,)
    ),
    "metrics": _table("metrics.csv"),
    "episode log": _table("episodes.csv"),
    "encoder checkpoint": Kind(
        CHECKPOINT,
        _encoder_checkpoint,
        mutated_safetensors,
        lambda path: _train_encoder(path.parent),
        (EncoderFileError, EncoderInputError),
    ),
    "geometry checkpoint": Kind(
        CHECKPOINT,
        _geometry_checkpoint,
        mutated_safetensors,
        lambda path: _train_geometry(path.parent),
        (EncoderFileError, EncoderInputError),
    ),
    "finder of water": Kind(
        "water.safetensors", _segmenters, mutated_safetensors, _read_segmenter, (EncoderFileError,)
    ),
    "cached maps": Kind("maps.npz", _maps, mutated_bytes, _read_maps, ()),
    "plug-in": Kind("mine.py", lambda _: [PLUGIN], mutated_lines, _read_plugin, (PluginError,)),
    "exported policy": Kind("policy.onnx", lambda _: [_exported()], _mutated_onnx, _read_onnx, _deploy_errors()),
}
"""By their names in the table."""
