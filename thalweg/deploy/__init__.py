"""Policies outside the simulator: export to one ONNX file, its player, and overlays of videos."""
