"""Policies outside the simulator: one ONNX file with all that a policy needs, and its player."""
