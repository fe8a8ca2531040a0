"""Recorded flights as standard data sets: what a recording holds, and its files, those of Minari and LeRobot."""
