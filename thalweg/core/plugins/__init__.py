"""Plug-ins: algorithms, tasks, encoders and report sections from outside the package, by entry points and by files."""
