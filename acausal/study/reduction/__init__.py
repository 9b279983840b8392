"""Reports on reduced models: what was left out, the gain in speed, and the loss in accuracy."""
