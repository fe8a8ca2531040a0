"""The leaderboard: trained policies of several results folders, ranked, on the paper's task and on others.

A row is ranked only if it has everything that is required of it; rows that lack something stand apart, or below, with
what they lack.
"""

from thalweg.bench.leaderboard.entries import Entry, entries
from thalweg.bench.leaderboard.page import leaderboard
from thalweg.bench.leaderboard.requirements import RUN_FILES, UNSEEN
from thalweg.bench.leaderboard.tasks import TaskEntry, task_entries

__all__ = ["RUN_FILES", "UNSEEN", "Entry", "TaskEntry", "entries", "leaderboard", "task_entries"]
