"""Player of exported policies by ONNX Runtime; PyTorch is not needed."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from thalweg.deploy.errors import ExportError

KEY = "thalweg"
"""Key of the JSON text in a file's metadata."""
FORMAT = 3
"""Version of the metadata of a file. Up to 2, moves had other names."""
INPUTS = ("image", "mask", "proprioception", "memory", "last_action", "fresh")
"""Names of all inputs, see `thalweg.deploy.network.ExportedNetwork`."""
NO_ACTION = -1
"""The last option at the beginning of a flight, where there is none."""


class OnnxPolicy:
    """A policy of an ONNX file that `thalweg export` wrote."""

    def __init__(self, session: Any, about: dict[str, Any]) -> None:
        self._session, self.about = session, about
        self.inputs: list[str] = about["inputs"]
        """Names of its inputs, see `thalweg.deploy.network.ExportedNetwork`."""

    @classmethod
    def load(cls, path: str | Path, threads: int = 1) -> "OnnxPolicy":
        """Return the policy of a file, to run on the CPU.

        Raises `ExportError` for a file that `thalweg export` did not write, and `OSError` if it cannot be opened.
        """
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
        content = Path(path).read_bytes()
        try:
            session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
            about = json.loads(session.get_modelmeta().custom_metadata_map[KEY])
        except Exception as error:  # ONNX Runtime raises classes of its own for each kind of damage
            raise ExportError(f"{path} is no policy that thalweg export wrote") from error
        taken = session.get_inputs()
        if wrong := about_error(about, [each.name for each in taken]) or _memory_error(about, taken):
            raise ExportError(f"{path} is no policy that thalweg export wrote: {wrong}")
        return cls(session, about)

    def run(self, given: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return the outputs by name for inputs by name."""
        names = [output.name for output in self._session.get_outputs()]
        return dict(zip(names, self._session.run(names, given), strict=True))

    def player(self, count: int = 1) -> "OnnxPlayer":
        """Return a player for `count` vehicles."""
        return OnnxPlayer(self, count)


def about_error(about: Any, inputs: Sequence[str]) -> str:
    """Return what is wrong with the description of a policy whose network has these inputs; empty for nothing."""
    if not isinstance(about, dict) or not {"inputs", "memory", "actions"} <= about.keys():
        return "its description lacks inputs, memory or actions"
    told = about["inputs"] if isinstance(about["inputs"], list) else []
    if sorted(map(str, told)) != sorted(inputs) or not {*inputs} <= {*INPUTS}:
        return f"its description names the inputs {about['inputs']!s:.60}, but its network takes {', '.join(inputs)}"
    if about.get("format") != FORMAT:
        return f"its format is {about.get('format')!r:.40}, not {FORMAT}: export the policy again"
    if type(about["memory"]) is not int or about["memory"] < 0:
        return f"its memory is {about['memory']!r:.40}, not a number"
    return "" if isinstance(about["actions"], dict) else f"its actions are {about['actions']!r:.40}, not a mapping"


def _memory_error(about: dict[str, Any], taken: Sequence[Any]) -> str:
    """Return what is wrong with the size of the memory in a description, whose network takes the inputs of a session;
    empty for nothing."""
    sizes = [each.shape[-1] for each in taken if each.name == "memory"]
    if sizes and isinstance(sizes[0], int) and sizes[0] != about["memory"]:
        return f"its memory is {about['memory']:,}, but its network takes one of {sizes[0]:,}"
    return ""


class OnnxPlayer:
    """An exported policy that flies N vehicles; it keeps their memories and last options."""

    def __init__(self, policy: OnnxPolicy, count: int) -> None:
        self.policy = policy
        self._fresh = np.ones(count, bool)
        self._memory = np.zeros((count, policy.about["memory"]), np.float32)
        branches = len(policy.about["actions"])
        self.last = np.full((count, branches), NO_ACTION) if "last_action" in policy.inputs else None
        """[N, A] options that were taken last; None for a policy that does not take them."""
        self.outputs: np.ndarray = np.zeros((count, 0), np.float32)
        """[N, K] outputs of the last step, which `outputs` of the metadata explains."""

    def __call__(
        self,
        image: np.ndarray | None = None,
        mask: np.ndarray | None = None,
        proprioception: np.ndarray | None = None,
        fresh: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return the options int64 [N, A] of the next move, or its numbers float32 [N, A] in -1..1.

        Args:
            image: uint8 [N, H, W, 3], sRGB.
            mask: uint8 [N, H, W], 255 where water is seen.
            proprioception: float32 [N, P], see `thalweg.env.task.proprioception`.
            fresh: bool [N], whether a flight begins; by default true at the first call only.

        Inputs that the policy does not take are ignored. Raises `ExportError` if one that it takes is missing.
        """
        seen = {"image": image, "mask": mask, "proprioception": proprioception}
        state = {"memory": self._memory, "last_action": self.last, "fresh": self._fresh if fresh is None else fresh}
        given = {name: {**seen, **state}[name] for name in self.policy.inputs}
        if missing := [name for name, value in given.items() if value is None]:
            raise ExportError(f"the policy takes {', '.join(missing)}, which was not given")
        found = self.policy.run(given)  # pyright: ignore[reportArgumentType]
        self.outputs = found["outputs"]
        self._memory = found.get("next_memory", self._memory)
        if self.last is not None:
            self.last = found["action"]
        self._fresh = np.zeros_like(self._fresh)
        return found["action"]
