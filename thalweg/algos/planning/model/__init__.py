"""The learned model of the environment: ensemble, inference, training data and fitting."""
