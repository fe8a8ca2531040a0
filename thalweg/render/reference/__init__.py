"""The slow definition of a frame, against which the kernels are tested."""
