"""On-policy algorithms, and the components that they share. Losses and updates are in each algorithm's own file."""
