"""The page of `thalweg fly`: to fly the river by hand, watch policies and pilots fly, and record flights."""
