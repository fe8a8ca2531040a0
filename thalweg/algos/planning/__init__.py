"""Planners: a model of the environment and its fitting, imagined rollouts, plan distributions, and the policy that
plans. The weighting of candidates stands in each algorithm's own file."""
