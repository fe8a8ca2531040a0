"""Wind, current and inertia in the rules: what they depend on, how a vehicle moves under them, and its step."""
