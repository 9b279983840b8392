"""Model reduction: the smallest model that computes given outputs."""
