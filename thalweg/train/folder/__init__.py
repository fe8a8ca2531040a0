"""Files in the folder of a run: record, checkpoints and logs; and the progress bar."""
