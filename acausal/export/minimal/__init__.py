"""As many states as a model has degrees of freedom, two for each."""
