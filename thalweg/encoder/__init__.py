"""Encoder of frames: variational autoencoder, training, files and fast frozen encoder."""

from thalweg.encoder.encoder import (
    DEFAULT_PATH,
    PACKAGED,
    Encoder,
    check_render_version,
    encoder_names,
    fold_batch_norms,
    load_encoder,
)
from thalweg.encoder.files import EncoderFileError, load_vae, save_geometry, save_vae
from thalweg.encoder.frame_size import sides
from thalweg.encoder.geometry import GeometryConfig, GeometryNetwork
from thalweg.encoder.plugin import EncoderPlugin, PluginEncoder, encoder_plugin, encoder_size
from thalweg.encoder.reconstruction import draw_reconstructions, mean_image_mse, reconstruct, reconstruction_mse
from thalweg.encoder.training import Source, TrainingResult, train_encoder
from thalweg.encoder.vae import ARCHITECTURES, VAE, EncoderInputError, VAEConfig, kl_divergence, vae_loss

__all__ = [
    "ARCHITECTURES",
    "DEFAULT_PATH",
    "PACKAGED",
    "VAE",
    "Encoder",
    "EncoderFileError",
    "EncoderInputError",
    "EncoderPlugin",
    "GeometryConfig",
    "GeometryNetwork",
    "PluginEncoder",
    "Source",
    "TrainingResult",
    "VAEConfig",
    "check_render_version",
    "draw_reconstructions",
    "encoder_names",
    "encoder_plugin",
    "encoder_size",
    "fold_batch_norms",
    "kl_divergence",
    "load_encoder",
    "load_vae",
    "mean_image_mse",
    "reconstruct",
    "reconstruction_mse",
    "save_geometry",
    "save_vae",
    "sides",
    "train_encoder",
    "vae_loss",
]
