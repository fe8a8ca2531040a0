"""Off-policy algorithms, and what they share: a replay buffer, critics of actions with target networks, and the update
schedule. Losses and updates are in each algorithm's own file."""
