"""Models with free inputs, and the optimal-control problems that docs/optimal-control.md goes through."""
