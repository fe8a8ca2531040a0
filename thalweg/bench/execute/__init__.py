"""Execution of suites: runner, executors and films of the flights."""
