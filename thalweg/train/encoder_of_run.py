"""The encoder of a run: where its file was, whether it is still there, and whose frames it was trained on."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from thalweg.core.cache import file_hash
from thalweg.core.config import parse_config
from thalweg.core.notices import notice
from thalweg.core.run_folder import differences
from thalweg.encoder import PACKAGED, Encoder, PluginEncoder, encoder_plugin, sides
from thalweg.render import Camera
from thalweg.train.errors import TrainingError
from thalweg.train.folder.run_record import ENCODER_FILE, ENCODER_PLUGIN


def context_of(policy: Any) -> dict[str, Any]:
    """Return the context in which a policy was trained; empty for one that was not."""
    return getattr(getattr(policy, "about", None), "context", {})


def file_of_its_own(encoder: Encoder) -> dict[str, Any]:
    """Return the entry of a context for the file of an encoder, or for a plug-in; empty for one that comes with the
    package."""
    if isinstance(encoder, PluginEncoder):
        return {ENCODER_PLUGIN: encoder.plugin.as_data()}
    file = Path(encoder.about["path"]).resolve()
    return {} if file in [path.resolve() for path in PACKAGED.values()] else {ENCODER_FILE: str(file)}


def packaged_name(digest: str) -> str | None:
    """Return the name of the encoder of the package whose file has a hash; None if none of them has it."""
    return next((name for name, path in PACKAGED.items() if path.is_file() and file_hash(path) == digest), None)


def encoder_of(policy: Any) -> Path | None:
    """Return the file of the encoder that a policy was trained with, wherever the package is, or the name of a plug-in;
    None if it names none.

    Raises `TrainingError`, which says which file or plug-in is needed, if that one is not where it was.
    """
    context = context_of(policy)
    needed, file = context.get("encoder"), context.get(ENCODER_FILE)
    if needed is None:
        return None
    if (name := packaged_name(needed)) is not None:
        return PACKAGED[name]
    if ENCODER_PLUGIN in context:
        name = needed.partition(" ")[0]
        if encoder_plugin(name) is not None:
            return Path(name)
        raise TrainingError(
            f"the policy was trained on the codes of {encoder_in_words(context)}, which is not here: give its file,"
            " such as --plugin mine.py, or install it"
        )
    if file is None:
        what = "its run did not record the file's name"
    elif not Path(file).is_file():
        what = "that file is not there any more"
    elif (found := file_hash(Path(file))) != needed:
        what = f"that file has changed since: its hash is {found} now"
    else:
        return Path(file)
    raise TrainingError(
        f"the policy was trained on the codes of {encoder_in_words(context)}, but {what}; name the file with --encoder"
    )


def encoder_in_words(context: Mapping[str, Any]) -> str:
    """Return what identifies the encoder that a policy was trained with."""
    digest = context["encoder"]
    if (name := packaged_name(digest)) is not None:
        return f"the encoder {name!r} that comes with the package"
    if ENCODER_PLUGIN in context:
        return f"the encoder {digest.partition(' ')[0]!r} of a plug-in, version {digest.partition(' ')[2]}"
    return f"{context.get(ENCODER_FILE, 'an encoder of its own')} (its hash: {digest})"


def check_camera_fits(camera: Camera, encoder: Encoder) -> None:
    """Raise `TrainingError` unless a camera draws frames of the size that an encoder takes."""
    check_size_fits(camera, encoder.config.size_px, str(encoder.about.get("path", "")))


def check_size_fits(
    camera: Camera, size_px: int | tuple[int, int], name: str, error: type[ValueError] = TrainingError
) -> None:
    """Raise an error unless a camera draws frames of the size (a side, or height and width) that the encoder of a name
    takes."""
    drawn, (height, width) = (camera.height_px, camera.width_px), sides(size_px)
    if drawn != (height, width):
        raise error(
            f"the camera draws frames of {drawn[0]} x {drawn[1]} pixels (height x width), but the encoder"
            f"{name and f' {name}'} takes {height} x {width}: give the camera height_px={height} and width_px={width},"
            f" or use an encoder that takes {drawn[0]} x {drawn[1]}"
        )


def camera_of_encoder(encoder: Encoder) -> Camera:
    """Return the camera whose frames an encoder was trained on; that of the levels, with the size that the encoder
    takes, if its file does not say it."""
    height, width = sides(encoder.config.size_px)
    told = encoder.about.get("camera")
    return Camera(height, width) if told is None else parse_config(Camera, told, "the camera of an encoder")


def tell_other_optics(camera: Camera, encoder: Encoder) -> None:
    """Print a notice if an encoder's file names another camera than that of a training: its codes tell less then."""
    if "camera" in encoder.about and (
        found := list(differences(camera_of_encoder(encoder).as_data(), camera.as_data()))
    ):
        notice(
            f"the encoder {encoder.about.get('path', '')} was trained on frames of another camera: {'; '.join(found)}"
        )
