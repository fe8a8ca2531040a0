"""Results folders: files, reading, statistics and inference."""
