"""Studies of a model as a whole: speed against accuracy, stability, reduction to what is asked."""
