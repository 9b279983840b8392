"""Models with free inputs, and the optimal-control problems of docs/optimal-control.md."""
