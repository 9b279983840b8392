"""Export of a model as CasADi functions, to a file, and as C."""
