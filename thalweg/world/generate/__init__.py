"""Generation of a river valley from a level and a seed."""
