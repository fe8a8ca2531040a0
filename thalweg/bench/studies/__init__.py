"""Studies beside the suites: encoders."""
