"""What algorithms that learn from everything they have seen have in common: a replay, critics of actions with slow
copies, and the pace of collecting and learning. Losses and updates stand in the algorithms' own files."""
