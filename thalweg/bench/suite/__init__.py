"""Suites as data: built-in, from YAML files, and as recorded in results."""
