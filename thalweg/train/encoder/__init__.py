"""Training of encoders on frames of our rivers."""
