"""Adapters for learners of other libraries, a module for each library; importing one imports its library.

Libraries that take Gymnasium's environments as they are have none; see docs/other-libraries.md.
"""
