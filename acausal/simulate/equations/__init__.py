"""One model with its numbers: the functions that integrators and events call."""
