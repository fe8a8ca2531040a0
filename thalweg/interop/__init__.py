"""Adapters for learners of other libraries, a module for each library; importing one imports its library.

Libraries that take Gymnasium's environments directly have no module here; see docs/other-libraries.md.
"""
