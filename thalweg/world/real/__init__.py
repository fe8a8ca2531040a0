"""Worlds from lines that others drew: centre lines and GeoJSON files of real rivers."""
