"""Parameter estimation from measurements, by least squares on runs of a model."""
