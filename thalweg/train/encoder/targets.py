"""Quantities that an encoder of geometry predicts: what the ideal eye sees, and what a camera can tell of each task.

Left out is what no frame shows, such as the time left and the way to a station far away. A quantity of one task is NaN
in the views of another. Letters: K views, P objects, T quantities.
"""

from collections.abc import Sequence

import numpy as np

from thalweg.core.suggestion import did_you_mean
from thalweg.encoder import EncoderInputError
from thalweg.env import RiverVectorEnv
from thalweg.env.task.ideal_eye import FEATURES, mirrored
from thalweg.env.task.priced.eye import RANGE_M, features_of
from thalweg.env.tasks import TASKS
from thalweg.render.records.camera import Camera
from thalweg.render.records.props import KIND, YAW, PropKind, X, Y, Z

PLACE = ("distance", "ahead", "left")
"""Numbers of an object in view: metres to it over the water, and how far it lies ahead and to the left."""
SEEN: dict[str, tuple[tuple[str, ...], tuple[PropKind, ...]]] = {
    "Swimmers": (("swimmer in view", "second swimmer in view"), (PropKind.SWIMMER, PropKind.KAYAK)),
    "Portage": (("station in view",), (PropKind.STATION,)),
}
"""Tasks whose objects in view are predicted: names of the nearest ones, and their kinds. A kayak counts as swimmer."""
SPAN_M = {PropKind.SWIMMER: (-2.0, 0.7), PropKind.KAYAK: (-2.1, 2.1), PropKind.STATION: (-2.6, 0.0)}
"""Where an object begins and ends, in metres along the direction in which it points; a tow buoy and a hut are parts."""
TOLD = {
    "Nests": ("in a reserve", "reserve begins", "reserve ends"),
    "RacingLine": ("clearance",),
    "Portage": ("over land",),
}
"""Numbers of the ideal eye that are predicted in each task, see `thalweg.env.task.priced.eye.TASK_FEATURES`."""
TASK_TARGETS: dict[str, tuple[str, ...]] = {
    task: (*(f"{name} {what}" for name in SEEN.get(task, ((), ()))[0] for what in PLACE), *TOLD.get(task, ()))
    for task in TASKS
}
"""Names of the quantities of each task."""
WEIGHTS = {
    "left bank": 4.0,
    "right bank": 4.0,
    "heading error": 4.0,
    "height": 2.0,
    "room above": 0.0,
    **{f"swimmer in view {what}": 2.0 for what in PLACE},
    "reserve begins": 2.0,
    "clearance": 2.0,
    "over land": 2.0,
}
"""Weights of quantities in the loss; that of all others is 1. The room above is the height once more."""
SHOWN = ("left bank", "right bank", "heading error", "height")
"""Quantities that decide a flight."""
SHOWN_OF_TASKS = ("swimmer in view distance", "reserve begins", "clearance", "station in view distance", "over land")
"""Quantities that decide the cost of a step."""


def targets_of(tasks: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the T quantities of views of some tasks.

    Raises `EncoderInputError` for a name of no task of the package, no task, or one that is given twice.
    """
    for task in tasks:
        if task not in TASKS:
            raise EncoderInputError(f"unknown task {task!r}{did_you_mean(task, TASKS)}; known: {', '.join(TASKS)}")
    if not tasks or len(set(tasks)) < len(tasks):
        raise EncoderInputError(f"tasks must be at least one, each once, not {', '.join(tasks) or 'none'}")
    return (*FEATURES, *(name for task in tasks for name in TASK_TARGETS[task]))


def weights_of(targets: Sequence[str]) -> tuple[float, ...]:
    """Return the weight [T] of each quantity in the loss."""
    return tuple(WEIGHTS.get(name, 1.0) for name in targets)


def shown_of(targets: Sequence[str]) -> tuple[str, ...]:
    """Return those of the quantities that a command tells when it has finished."""
    return (*SHOWN, *(name for name in SHOWN_OF_TASKS if name in targets))


def mirrored_targets(truths: np.ndarray, targets: Sequence[str]) -> np.ndarray:
    """Return the quantities [K, T] with these names of mirror images of views."""
    count = len(FEATURES)
    signs = np.array([-1.0 if name.endswith(" left") else 1.0 for name in targets[count:]], truths.dtype)
    return np.concatenate([mirrored(truths[:, :count]), truths[:, count:] * signs], axis=1)


def truths_in(env: RiverVectorEnv, props: np.ndarray) -> np.ndarray:
    """Return the quantities [N, T] float32 of the views of N environments now, those of the environment's own task.

    props: [N, P, 6], the objects about each vehicle.
    """
    task, eye = env.config.task, env.ideal_eye()
    names, kinds = SEEN.get(task, ((), ()))
    places = nearest_in_view(env.camera, env.state.pose, props, kinds, len(names)).reshape(len(eye), -1)
    told = [features_of(task).index(name) for name in TOLD.get(task, ())]
    return np.concatenate([eye[:, : len(FEATURES)], places, eye[:, told]], axis=1)


def nearest_in_view(
    camera: Camera, poses: np.ndarray, props: np.ndarray, kinds: Sequence[PropKind], count: int
) -> np.ndarray:
    """Return `PLACE` [K, count, 3] float32 of the nearest objects of some kinds that lie in the image of a camera.

    An object is in view if the image contains its middle at the water, or an end of it, less than `RANGE_M` away;
    whether something hides it does not matter. Its place is that of its middle; `RANGE_M`, 0, 0 is that of none.

    Args:
        camera: With its own pitch and field of view.
        poses: [K, 4].
        props: [K, P, 6], see `thalweg.render.records.props`.
    """
    found = np.broadcast_to(np.array([RANGE_M, 0.0, 0.0], np.float32), (len(poses), count, 3)).copy()
    away = props[..., [X, Y]].astype(np.float64) - poses[:, None, :2]
    distance, yaw = np.hypot(*np.moveaxis(away, -1, 0)), poses[:, None, 3]
    ahead = away[..., 0] * np.cos(yaw) + away[..., 1] * np.sin(yaw)
    left = away[..., 1] * np.cos(yaw) - away[..., 0] * np.sin(yaw)
    seen = np.isin(props[..., KIND], kinds) & any_in_image(camera, poses, props)
    far = np.where(seen & (distance < RANGE_M), distance, np.inf)
    for place, which in enumerate(np.argsort(far, axis=1, kind="stable")[:, :count].T):
        rows = np.flatnonzero(np.isfinite(far[np.arange(len(far)), which]))
        which = which[rows]
        found[rows, place] = np.stack([each[rows, which] for each in (distance, ahead, left)], axis=1)
    return found


def any_in_image(camera: Camera, poses: np.ndarray, props: np.ndarray) -> np.ndarray:
    """Return whether the middle or an end of objects [K, P, 6] lies in the images of a camera at poses [K, 4], as
    [K, P] bool."""
    spans = np.array([(0.0, *SPAN_M.get(kind, (0.0, 0.0))) for kind in PropKind])
    along = spans[props[..., KIND].astype(np.int64)]
    direction = np.stack([np.cos(props[..., YAW]), np.sin(props[..., YAW]), np.zeros(props.shape[:2])], axis=-1)
    points = props[..., None, X : Z + 1] + along[..., None] * direction[..., None, :]
    seen = in_image(camera, poses, points.reshape(len(poses), -1, 3)).reshape(along.shape)
    return np.logical_or.reduce(seen, axis=-1)


def in_image(camera: Camera, poses: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return whether points [K, P, 3] lie in the images of a camera at poses [K, 4], as [K, P] bool."""
    matrices = camera.camera_matrices(poses)
    local = np.einsum("kij,kpj->kpi", matrices.R, points.astype(np.float64)) + matrices.t[:, None]
    column, row = camera.pixels_of(local)  # NaN is in no image
    # A pixel with the centre k reaches from k - 0.5 to k + 0.5.
    beside = np.abs(column - 0.5 * (camera.width_px - 1)) <= 0.5 * camera.width_px
    above = np.abs(row - 0.5 * (camera.height_px - 1)) <= 0.5 * camera.height_px
    return beside & above
