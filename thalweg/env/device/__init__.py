"""The step of `TensorRiverEnv`: one function per environment, for a loop on the CPU or a thread of a GPU."""
