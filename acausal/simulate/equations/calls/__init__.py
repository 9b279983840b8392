"""Calls of CasADi functions that work directly on NumPy memory."""
