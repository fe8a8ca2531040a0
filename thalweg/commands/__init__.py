"""The commands of `thalweg`: fields are the options, their docstrings the help, `run` does it.

What a command needs is imported when it runs, so that `thalweg --help` answers at once.
"""
