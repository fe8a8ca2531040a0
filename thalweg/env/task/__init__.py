"""The rules of the task: motion, progress, reward, cost and termination."""
