"""Parts that all learners share: errors, settings, state and optimiser."""
