"""The oracle: a planner that knows the map and all that moves, and trades return for cost at a given price."""
