"""Independent systems of one model, as separate compiled models."""
