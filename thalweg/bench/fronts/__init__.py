"""Fronts of the oracle, by which policies of tasks with a price are judged."""
