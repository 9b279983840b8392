"""A model with values of its parameters, as the functions that integrators and events call."""
