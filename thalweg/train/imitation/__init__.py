"""Imitation on rivers: the gate of a teacher, flights, stored sequences that are drawn anew, and the run."""
