"""A calibration of a camera behind a lens, as ROS writes it."""

LENS = """
image_width: 640
image_height: 480
camera_matrix: {rows: 3, cols: 3, data: [330.0, 0.0, 330.0, 0.0, 325.0, 230.0, 0.0, 0.0, 1.0]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.2, 0.04, 0.001, -0.001, 0.0]}
"""
