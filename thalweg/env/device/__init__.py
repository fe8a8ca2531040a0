"""Episodes as one function per environment, for a CPU loop or a GPU thread."""
