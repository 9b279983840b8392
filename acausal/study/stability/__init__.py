"""Where methods fail on a model, and why: eigenvalues along a run, largest steps, a verdict."""
