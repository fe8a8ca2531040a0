"""The network of an exported policy as plain operations: preprocessing, encoder, memory and the choice of actions.

Letters: N vehicles, C channels, H, W pixels, Z numbers of a code, P of proprioception, D numbers of an observation or
features, M numbers of the memory, A branches of an action, K outputs: parameters of the distribution of actions. Layers
are copies, so that what becomes of the network does not reach the policy.
"""

from copy import deepcopy

import torch
from torch import Tensor, nn
from torch.nn import functional

from thalweg.algos.maths import gaussian
from thalweg.algos.policy.actions import Actions
from thalweg.algos.policy.memory import Gru
from thalweg.algos.policy.mlp import layers_of
from thalweg.algos.policy.mlp_autograd import FUNCTIONS
from thalweg.algos.policy.normaliser import CLIP, Normaliser
from thalweg.algos.policy.policy import Policy
from thalweg.algos.policy.vision import NO_OPTION, Convolutions
from thalweg.encoder import Encoder
from thalweg.encoder.encoder import fold_batch_norms
from thalweg.encoder.vae import LEAK


class CodeLayers(nn.Module):
    """Codes [N, Z] of pixels [N, C, H, W] float32 in 0..255, as an encoder with folded normalisation computes them."""

    def __init__(self, encoder: Encoder) -> None:
        super().__init__()
        convolutions, head = fold_batch_norms(encoder.model)
        self.head = deepcopy(head)
        self.convolutions = nn.ModuleList(convolutions)

    def forward(self, pixels: Tensor) -> Tensor:
        for convolution in self.convolutions:
            pixels = functional.leaky_relu(convolution(pixels), LEAK)
        return self.head(pixels.flatten(1))


class EyeLayers(nn.Module):
    """Features [N, D] of pixels [N, C, H, W] float32 in 0..255 and last options [N, A], see `Convolutions.forward`."""

    def __init__(self, eyes: Convolutions) -> None:
        super().__init__()
        self.convolutions, self.linear = deepcopy(eyes.convolutions), deepcopy(eyes.linear)
        self.last_options = deepcopy(eyes.last_options)

    def forward(self, pixels: Tensor, last: Tensor) -> Tensor:
        seen = self.convolutions(pixels * (1.0 / 128.0) - 1.0)
        features = functional.relu(self.linear(seen.flatten(1)))
        return torch.cat([features, self.last_options(last + 1)], -1)


class Scaling(nn.Module):
    """Normalised observations [N, D], in standard deviations from the mean, see `Normaliser`."""

    shift: Tensor
    scale: Tensor

    def __init__(self, normaliser: Normaliser) -> None:
        super().__init__()
        found = normaliser.arrays()
        self.register_buffer("shift", torch.from_numpy(found.shift.copy()))
        self.register_buffer("scale", torch.from_numpy(found.scale.copy()))
        self.clips = normaliser.enabled and normaliser.count > 0

    def forward(self, obs: Tensor) -> Tensor:
        return ((obs - self.shift) * self.scale).clamp(-CLIP, CLIP) if self.clips else obs


class MemoryCell(nn.Module):
    """The next memory [N, M] from features [N, D] and the memory, as `Gru.step` computes it."""

    def __init__(self, gru: Gru) -> None:
        super().__init__()
        self.gru = deepcopy(gru)

    def forward(self, seen: Tensor, memory: Tensor) -> Tensor:
        gru = self.gru
        given = functional.linear(seen, gru.weight_in, gru.bias_in).chunk(3, -1)
        kept = functional.linear(memory, gru.weight, gru.bias).chunk(3, -1)
        reset, update = torch.sigmoid(given[0] + kept[0]), torch.sigmoid(given[1] + kept[1])
        return (1.0 - update) * torch.tanh(given[2] + reset * kept[2]) + update * memory


class LastFrames(nn.Module):
    """The last F observations [N, F D], the newest last, as `FrameStack` keeps them; F - 1 of them are remembered."""

    def __init__(self, frames: int, size: int) -> None:
        super().__init__()
        self.frames, self.size = frames, size

    @property
    def kept(self) -> int:
        """Number of remembered numbers, (F - 1) D."""
        return (self.frames - 1) * self.size

    def forward(self, obs: Tensor, older: Tensor, fresh: Tensor) -> tuple[Tensor, Tensor]:
        """Return the frames [N, F D] with the observation [N, D], and those to remember [N, (F - 1) D]."""
        older = torch.where(fresh.unsqueeze(-1), obs.repeat(1, self.frames - 1), older)
        stacked = torch.cat([older, obs], -1)
        return stacked, stacked[:, self.size :]


class Choice(nn.Module):
    """The most probable actions [N, A], and the outputs [N, K], from features [N, D] or [N, D + M]."""

    sizes: Tensor

    def __init__(self, policy: Policy) -> None:
        super().__init__()
        stack = policy.actor.stack
        self.activation, self.actions, self.temperature = stack.activation, policy.actions, policy.temperature
        self.log_std = deepcopy(policy.actor.log_std)
        self.register_buffer("sizes", torch.tensor(policy.actions.sizes, dtype=torch.int64))
        layers = layers_of(stack.flat.detach().clone(), 1, stack.sizes)
        self.weights = nn.ParameterList([weight[0] for weight, _ in layers])
        self.biases = nn.ParameterList([bias.reshape(-1) for _, bias in layers])

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            features = FUNCTIONS[self.activation](features @ weight + bias)
        outputs = features @ self.weights[-1] + self.biases[-1]
        if self.log_std is not None:
            outputs = torch.cat([outputs, self.log_std.expand_as(outputs)], -1)
        return most_probable(outputs / self.temperature, self.actions, self.sizes), outputs


def most_probable(parameters: Tensor, actions: Actions, sizes: Tensor) -> Tensor:
    """Return the most probable actions [N, A], options int64 or numbers float32 in -1..1, of parameters [N, K].

    `sizes` int64 [A] are the numbers of options of the branches, none for numbers.
    """
    if actions.kind == "categorical":
        return torch.stack([branch.argmax(-1) for branch in parameters.split(list(actions.sizes), -1)], -1)
    numbers = parameters[:, : actions.count]
    if actions.kind != "gaussian":
        numbers = numbers.tanh()
    if actions.sizes:
        return gaussian.discretised(numbers, sizes, scaled=actions.adapter == "box_scaled")
    return numbers.clamp(-1.0, 1.0)


class ExportedNetwork(nn.Module):
    """The computation of an exported file.

    Inputs, of which a policy takes those that it needs, in this order: `image` uint8 [N, H, W, 3]; `mask` uint8
    [N, H, W]; `proprioception` float32 [N, P]; `fresh` bool [N], true where a flight begins; `memory` float32 [N, M];
    `last_action` int64 [N, A]. Outputs: `action` [N, A], options int64 or numbers float32; `outputs` float32 [N, K];
    `next_memory` float32 [N, M] of policies with a memory: that of `LastFrames`, then that of `MemoryCell`.
    """

    def __init__(self, policy: Policy, encoder: Encoder | None, inputs: tuple[str, ...]) -> None:
        super().__init__()
        self.inputs = inputs
        actor = policy.actor
        self.codes = None if encoder is None else CodeLayers(encoder)
        self.eyes = None if actor.eyes is None else EyeLayers(actor.eyes)
        self.stack = None if policy.frames == 1 else LastFrames(policy.frames, policy.obs_size)
        self.scaling = Scaling(policy.normaliser)
        self.cell = None if actor.gru is None else MemoryCell(actor.gru)
        self.choice = Choice(policy)

    def forward(self, *given: Tensor) -> tuple[Tensor, ...]:
        of = dict(zip(self.inputs, given, strict=True))
        features = self._seen(of)
        following: list[Tensor] = []
        if self.stack is not None:
            features, older = self.stack(features, of["memory"][:, : self.stack.kept], of["fresh"])
            following.append(older)
        if self.eyes is None:
            features = self.scaling(features)
        if self.cell is not None:
            kept = of["memory"] if self.stack is None else of["memory"][:, self.stack.kept :]
            memory = self.cell(features, torch.where(of["fresh"].unsqueeze(-1), 0.0, kept))
            following.append(memory)
            features = torch.cat([features, memory], -1)
        action, outputs = self.choice(features)
        return (action, outputs, torch.cat(following, -1)) if following else (action, outputs)

    def _seen(self, of: dict[str, Tensor]) -> Tensor:
        """Return what is seen and felt: features of images, or an observation [N, D] that is not normalised."""
        parts = [of["image"]] if "image" in of else []
        parts += [of["mask"].unsqueeze(-1)] if "mask" in of else []
        pixels = torch.cat(parts, -1).permute(0, 3, 1, 2).float()
        if self.eyes is not None:
            last = torch.where(of["fresh"].unsqueeze(-1), NO_OPTION, of["last_action"])
            return self.eyes(pixels, last)
        assert self.codes is not None
        codes = self.codes(pixels)
        if "proprioception" in of:
            codes = torch.cat([codes, of["proprioception"]], -1)
        return codes
