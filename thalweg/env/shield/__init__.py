"""Shield of a policy: remembered water from past masks, and the moves that would leave it."""
