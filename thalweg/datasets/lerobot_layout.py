"""The layout of LeRobot's data sets, version 3.0: names of files, and the features of each frame.

LeRobot chooses inputs and outputs of its policies by names that begin with "observation" and "action". Only the
camera's picture, what is measured aboard, and the move have such names.
"""

from typing import Any

from thalweg.core.video import PIXELS
from thalweg.datasets.episode import ACTION_NAMES, LAYERS, POSE_NAMES, About

CODEBASE_VERSION = "v3.0"
CHUNK = "chunk-{chunk_index:03d}/file-{file_index:03d}"
DATA_PATH = f"data/{CHUNK}.parquet"
VIDEO_PATH = f"videos/{{video_key}}/{CHUNK}.mp4"
EPISODES_PATH = f"meta/episodes/{CHUNK}.parquet"
FORMAT = 1
"""Version of the file `ABOUT`, which holds what LeRobot's files have no place for."""
INFO, STATS, TASKS, ABOUT = "meta/info.json", "meta/stats.json", "meta/tasks.parquet", "meta/thalweg.json"
FILES_PER_CHUNK = 1000
"""Number of episodes, each of which is a file, in a folder."""
CAMERA = "observation.images.camera"
STATE = "observation.state"
IMAGE_AXES = ["height", "width", "channels"]
INDICES: dict[str, dict[str, Any]] = {
    "timestamp": {"dtype": "float32", "shape": [1], "names": None},
    "frame_index": {"dtype": "int64", "shape": [1], "names": None},
    "episode_index": {"dtype": "int64", "shape": [1], "names": None},
    "index": {"dtype": "int64", "shape": [1], "names": None},
    "task_index": {"dtype": "int64", "shape": [1], "names": None},
}
"""Features that every data set of LeRobot has."""


def features_of(about: About, size_px: tuple[int, int], *, video: bool, discrete: bool) -> dict[str, dict[str, Any]]:
    """Return dtype, shape and names of all features of a frame.

    Args:
        about: Describes the data set.
        size_px: H and W.
        video: Whether the colours are a video.
        discrete: Whether the actions are options.
    """
    height, width = size_px

    def numbers(count: int, dtype: str = "float32", names: Any = None) -> dict[str, Any]:
        return {"dtype": dtype, "shape": [count], "names": names}

    camera = {"dtype": "video" if video else "image", "shape": [height, width, 3], "names": IMAGE_AXES}
    layers: dict[str, dict[str, Any]] = {
        "mask": {"dtype": "image", "shape": [height, width, 1], "names": IMAGE_AXES},
        "depth": {"dtype": "float32", "shape": [height, width], "names": IMAGE_AXES[:2]},
        "class": {"dtype": "image", "shape": [height, width, 1], "names": IMAGE_AXES},
    }
    return {
        CAMERA: camera | ({"info": about_video(size_px, about.fps)} if video else {}),
        **{name: layers[name] for name in LAYERS if name in about.layers},
        STATE: numbers(len(about.proprioception), names=list(about.proprioception)),
        "action": numbers(len(ACTION_NAMES), names=list(ACTION_NAMES)),
        **({"option": numbers(len(ACTION_NAMES), "int64", list(ACTION_NAMES))} if discrete else {}),
        "pose": numbers(len(POSE_NAMES), "float64", list(POSE_NAMES)),
        "clock_s": numbers(1, "float64"),
        "pilot": numbers(1, "string"),
        "next.reward": numbers(1),
        "next.cost": numbers(len(about.cost_kinds), names=list(about.cost_kinds)),
        "next.reason": numbers(1, "int64"),
        "next.done": numbers(1, "bool"),
        "next.success": numbers(1, "bool"),
        **INDICES,
    }


def about_video(size_px: tuple[int, int], fps: int) -> dict[str, Any]:
    """Return LeRobot's metadata of a video of frames of H x W pixels, given as `size_px`."""
    return {
        "video.height": size_px[0],
        "video.width": size_px[1],
        "video.codec": "h264",
        "video.pix_fmt": PIXELS,
        "video.is_depth_map": False,
        "video.fps": fps,
        "video.channels": 3,
        "has_audio": False,
    }


def place(number: int) -> dict[str, int]:
    """Return the indices of chunk and file of an episode."""
    return {"chunk_index": number // FILES_PER_CHUNK, "file_index": number % FILES_PER_CHUNK}


def info_of(features: dict[str, Any], about: About, lengths: list[int], tasks: int, *, video: bool) -> dict[str, Any]:
    """Return the content of the file `INFO`; `lengths`: steps of each episode, `tasks`: number of tasks."""
    return {
        "codebase_version": CODEBASE_VERSION,
        "robot_type": "thalweg",
        "total_episodes": len(lengths),
        "total_frames": sum(lengths),
        "total_tasks": tasks,
        "chunks_size": FILES_PER_CHUNK,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": about.fps,
        "splits": {"train": f"0:{len(lengths)}"},
        "data_path": DATA_PATH,
        "video_path": VIDEO_PATH if video else None,
        "features": features,
    }
