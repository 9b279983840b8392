"""CasADi functions called on NumPy's memory."""
