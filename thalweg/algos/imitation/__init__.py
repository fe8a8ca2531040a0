"""Imitation of a teacher that knows the map: DAgger into a policy that sees images."""
