"""The scripted pilot, which knows the map: its route, its control law, and poses of its flights."""
