"""What algorithms that learn from their latest rollout alone have in common. Losses and updates stand in the
algorithms' own files."""
