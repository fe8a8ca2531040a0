"""Tables that are computed once per process or world: plant impostors, ripples and sky."""
