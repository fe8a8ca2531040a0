"""Tests of the layers for masks: the features of dense convolutions, for masks of any content."""

import numpy as np
import pytest
import torch

from tests.encoder.test_encoder import trained_looking
from thalweg.encoder import VAEConfig, fold_batch_norms
from thalweg.encoder.mask_layers import (
    DRY,
    MIXED,
    SPARSE_LAYERS,
    WET,
    _kinds_of_windows,
    encode_masks,
    mask_layers,
    output_shape,
)
from thalweg.encoder.vae import LEAK

SIZE = 64


def river() -> np.ndarray:
    """A mask with water below a slanted bank, an island that touches the border, and a single pixel of land."""
    y, x = np.mgrid[:SIZE, :SIZE]
    water = y > 20 + x // 3
    water[50:, :3] = False
    water[60, 40] = False
    return np.where(water, 255, 0).astype(np.uint8)


MASKS = {
    "dry": np.zeros((SIZE, SIZE), np.uint8),
    "wet": np.full((SIZE, SIZE), 255, np.uint8),
    "grey": np.full((SIZE, SIZE), 7, np.uint8),
    "river": river(),
    "river at the left and above": river()[::-1, ::-1].copy(),
    "noise": np.random.default_rng(0).integers(0, 256, (SIZE, SIZE)).astype(np.uint8),
}

OTHER_SIZES = {"wide": np.ascontiguousarray(river()[:40]), "high": np.ascontiguousarray(MASKS["noise"][:, :24])}


@pytest.fixture(scope="module")
def convolutions() -> list[torch.nn.Conv2d]:
    return fold_batch_norms(trained_looking(VAEConfig(inputs="mask", latent=4, size_px=SIZE)))[0]


def features_of(convolutions: list[torch.nn.Conv2d], masks: np.ndarray) -> np.ndarray:
    layers = mask_layers(convolutions, masks.shape[1:])
    features = np.full((len(masks), *output_shape(layers)), np.nan, np.float32)
    encode_masks(masks, layers, features)
    return features


@torch.inference_mode()
def dense_features_of(convolutions: list[torch.nn.Conv2d], masks: np.ndarray) -> np.ndarray:
    images = torch.from_numpy(masks).float().unsqueeze(1)
    for convolution in convolutions[:SPARSE_LAYERS]:
        images = torch.nn.functional.leaky_relu(convolution(images), LEAK)
    return images.permute(0, 2, 3, 1).numpy()


@pytest.mark.parametrize("name", [*MASKS, *OTHER_SIZES])
def test_features_are_those_of_dense_convolutions(convolutions, name):
    masks = (MASKS | OTHER_SIZES)[name][None]
    expected = dense_features_of(convolutions, masks)
    assert expected.std() > 0.01
    np.testing.assert_allclose(features_of(convolutions, masks), expected, rtol=0, atol=2e-6 * np.abs(expected).max())


def test_a_mask_has_the_same_bits_in_any_batch(convolutions):
    masks = np.stack(list(MASKS.values()))
    together = features_of(convolutions, masks)
    for index in range(len(masks)):
        np.testing.assert_array_equal(features_of(convolutions, masks[index : index + 1])[0], together[index])


def test_the_kind_of_an_output_is_what_all_its_inputs_have_in_common():
    kinds = np.full((8, 8), DRY, np.uint8)
    kinds[:, 5:] = WET
    kinds[7, 0] = MIXED
    found = np.zeros((4, 4), np.uint8)
    _kinds_of_windows(kinds, found)
    # Output 2 of a row sees columns 3 to 5; output 0 sees its own two, and the padding before them has no kind.
    expected = np.array([[DRY, DRY, MIXED, WET]] * 4, np.uint8)
    expected[3, 0] = MIXED
    np.testing.assert_array_equal(found, expected)
