"""Models of wind and of inertia, which know neither rivers nor rules: their configs, formulas and filters."""
