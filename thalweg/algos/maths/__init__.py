"""Formulas that algorithms share, as pure functions of arrays; each names its source and checks shapes first."""
