"""Diagnosis by the null vectors of a singular system: unknowns that are free, and equations that are dependent."""
