"""Encoder of frames: the variational autoencoder, its training, its files, and its fast frozen form."""

from thalweg.encoder.encoder import DEFAULT_PATH, Encoder, check_render_version, folded, load_encoder
from thalweg.encoder.files import EncoderFileError, load_vae, save_vae
from thalweg.encoder.reconstruction import mean_image_mse, reconstruct, reconstruction_mse
from thalweg.encoder.reconstruction_figure import draw_reconstructions
from thalweg.encoder.training import Source, TrainingResult, train_encoder
from thalweg.encoder.vae import ARCHITECTURES, VAE, EncoderInputError, VAEConfig, kl_divergence, vae_loss

__all__ = [
    "ARCHITECTURES",
    "DEFAULT_PATH",
    "VAE",
    "Encoder",
    "EncoderFileError",
    "EncoderInputError",
    "Source",
    "TrainingResult",
    "VAEConfig",
    "check_render_version",
    "draw_reconstructions",
    "folded",
    "kl_divergence",
    "load_encoder",
    "load_vae",
    "mean_image_mse",
    "reconstruct",
    "reconstruction_mse",
    "save_vae",
    "train_encoder",
    "vae_loss",
]
