"""Costs and objects of the tasks beside the paper's: swimmers, reserves, clearance and land."""
