"""Receding horizons: controllers and estimators."""
