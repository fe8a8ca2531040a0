"""Films and picture sheets."""
