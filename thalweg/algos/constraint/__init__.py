"""Cost limits and the Lagrange multipliers that enforce them."""
