"""The folder of a run: record, checkpoints, logs and progress."""
