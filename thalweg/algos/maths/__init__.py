"""The formulas that algorithms share: pure functions of arrays, each with its source, its shapes checked first."""
