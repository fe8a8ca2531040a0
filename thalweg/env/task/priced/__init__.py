"""What has a price in the tasks beside the paper's: swimmers, reserves, clearance and land, as rules and as objects."""
