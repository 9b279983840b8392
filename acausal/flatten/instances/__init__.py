"""The instance tree of a model, and the statements of its components."""
