"""One step of a fixed-step method as a function, and as C."""
