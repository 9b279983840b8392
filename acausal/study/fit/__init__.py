"""Parameters from measurements: least squares on runs of a model."""
