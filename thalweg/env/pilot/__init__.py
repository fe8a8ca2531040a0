"""The scripted pilot, which knows the map."""
