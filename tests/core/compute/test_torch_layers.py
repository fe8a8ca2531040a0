"""Layers without initial weights of their own."""

import torch
from torch import nn

from thalweg.core.compute.torch_layers import uninitialised


def test_a_layer_is_made_without_a_draw_of_the_global_generator():
    before = torch.get_rng_state()
    layers = uninitialised(nn.Conv2d, 3, 4, 5, 2, 1), uninitialised(nn.Linear, 6, 7, device=torch.device("cpu"))
    assert torch.equal(torch.get_rng_state(), before)
    assert (layers[0].weight.shape, layers[0].stride, layers[0].padding) == ((4, 3, 5, 5), (2, 2), (1, 1))
    assert layers[1].weight.shape == (7, 6) and layers[1].weight.is_cpu and layers[1].weight.requires_grad
