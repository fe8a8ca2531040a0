"""Evaluation of policies, suites of runs, and the reports on their results."""
