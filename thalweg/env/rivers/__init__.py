"""Rivers of a vector environment: one for each environment, or another one for each episode."""
