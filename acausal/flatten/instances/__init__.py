"""The tree of components, and what each of them states."""
