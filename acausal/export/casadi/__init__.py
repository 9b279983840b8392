"""A model as CasADi functions, in a file, in C, and in the words of other packages."""
