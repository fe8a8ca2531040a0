"""Thalweg: a photo-realistic river world and a benchmark of safe reinforcement learning on it."""
