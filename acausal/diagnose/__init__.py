"""Diagnosis of models whose equations do not determine their unknowns, in terms of components and equations.

Every finder looks for one cause and returns the error that names it, or None. `causes.probable` calls them in the order
in which causes explain each other: an open input, then a component with too few or too many equations, then equations
that are dependent for the values of their coefficients.
"""
