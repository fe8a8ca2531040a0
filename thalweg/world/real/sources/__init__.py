"""Readers of the files in which people keep rivers: GeoJSON, Overpass JSON, GPX and KML."""
