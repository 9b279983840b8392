"""Which methods fail on a model, and why: eigenvalues along a run, largest stable steps, a verdict."""
