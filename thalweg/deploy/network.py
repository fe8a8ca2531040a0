"""The network of an exported policy as plain operations: preprocessing, encoder, memory and the choice of actions.

Letters: N vehicles, C channels, H, W pixels, Z numbers of a code, P of proprioception, D features, M numbers of the
memory, A branches of an action, K outputs: the logits of all options.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

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
        convolutions, self.head = fold_batch_norms(encoder.model)
        self.convolutions = nn.ModuleList(convolutions)

    def forward(self, pixels: Tensor) -> Tensor:
        for convolution in self.convolutions:
            pixels = functional.leaky_relu(convolution(pixels), LEAK)
        return self.head(pixels.flatten(1))


class EyeLayers(nn.Module):
    """Features [N, D] of pixels [N, C, H, W] float32 in 0..255 and last options [N, A], see `Convolutions.forward`."""

    def __init__(self, eyes: Convolutions) -> None:
        super().__init__()
        self.convolutions, self.linear = eyes.convolutions, eyes.linear

    def forward(self, pixels: Tensor, last: Tensor) -> Tensor:
        seen = self.convolutions(pixels * (1.0 / 128.0) - 1.0)
        features = functional.relu(self.linear(seen.flatten(1)))
        return torch.cat([features, torch.where(last >= 0, last - 1, 0).float()], -1)


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
        self.gru = gru

    def forward(self, seen: Tensor, memory: Tensor) -> Tensor:
        gru = self.gru
        given = functional.linear(seen, gru.weight_in, gru.bias_in).chunk(3, -1)
        kept = functional.linear(memory, gru.weight, gru.bias).chunk(3, -1)
        reset, update = torch.sigmoid(given[0] + kept[0]), torch.sigmoid(given[1] + kept[1])
        return (1.0 - update) * torch.tanh(given[2] + reset * kept[2]) + update * memory


class Choice(nn.Module):
    """The most probable options [N, A], and the outputs [N, K], from features [N, D] or [N, D + M]."""

    def __init__(self, policy: Policy) -> None:
        super().__init__()
        stack = policy.actor.stack
        self.activation, self.actions = stack.activation, policy.actions
        layers = layers_of(stack.flat.detach().clone(), 1, stack.sizes)
        self.weights = nn.ParameterList([weight[0] for weight, _ in layers])
        self.biases = nn.ParameterList([bias.reshape(-1) for _, bias in layers])

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            features = FUNCTIONS[self.activation](features @ weight + bias)
        outputs = features @ self.weights[-1] + self.biases[-1]
        return most_probable(outputs, self.actions), outputs


def most_probable(outputs: Tensor, actions: Actions) -> Tensor:
    """Return the most probable options [N, A] of discrete actions, from a network's outputs [N, K]."""
    return torch.stack([branch.argmax(-1) for branch in outputs.split(list(actions.sizes), -1)], -1)


class ExportedNetwork(nn.Module):
    """The computation of an exported file.

    Inputs, of which a policy takes those that it needs, in this order: `image` uint8 [N, H, W, 3]; `mask` uint8
    [N, H, W]; `proprioception` float32 [N, P]; `fresh` bool [N], true where a flight begins; `memory` float32 [N, M];
    `last_action` int64 [N, A]. Outputs: `action` int64 [N, A], `outputs` float32 [N, K] and, with a
    memory, `next_memory` float32 [N, M].
    """

    def __init__(self, policy: Policy, encoder: Encoder | None, inputs: tuple[str, ...]) -> None:
        super().__init__()
        self.inputs = inputs
        actor = policy.actor
        self.codes = None if encoder is None else CodeLayers(encoder)
        self.eyes = None if actor.eyes is None else EyeLayers(actor.eyes)
        self.scaling = Scaling(policy.normaliser)
        self.cell = None if actor.gru is None else MemoryCell(actor.gru)
        self.choice = Choice(policy)

    def forward(self, *given: Tensor) -> tuple[Tensor, ...]:
        of = dict(zip(self.inputs, given, strict=True))
        seen = self._features(of)
        following: tuple[Tensor, ...] = ()
        features = seen
        if self.cell is not None:
            kept = torch.where(of["fresh"].unsqueeze(-1), 0.0, of["memory"])
            memory = self.cell(seen, kept)
            features, following = torch.cat([seen, memory], -1), (memory,)
        action, outputs = self.choice(features)
        return action, outputs, *following

    def _features(self, of: dict[str, Tensor]) -> Tensor:
        """Return the features [N, D] that the memory and the choice take."""
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
        return self.scaling(codes)
