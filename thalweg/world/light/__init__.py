"""Baked sun and sky light of a valley."""
