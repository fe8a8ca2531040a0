"""Recorded flights as data sets of LeRobot and Minari: the record of a flight, writers and readers."""
