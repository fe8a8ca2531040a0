"""Evaluation of policies: baselines, conditions, episodes."""
