"""Episodes of a vector environment: how they are asked for, begin, are told of in `info`, and are stored."""
