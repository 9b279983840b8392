"""What is wrong with a model whose equations do not determine its unknowns, in the words of its author.

Every finder looks for one cause and returns the error that names it, or None. `causes.probable` asks them in the order
in which they explain each other: an open input, then a component that states too little or too much, then equations
that depend on each other by their numbers.
"""
