"""Collection of rollouts from any Gymnasium vector environment."""
