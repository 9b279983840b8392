"""Events as CasADi functions."""
