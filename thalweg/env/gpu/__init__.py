"""The rules on a GPU: a thread an environment."""
