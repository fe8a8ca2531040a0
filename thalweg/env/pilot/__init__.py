"""Pilots that know the map: the scripted one, the steady one, their routes, and poses of flights."""
