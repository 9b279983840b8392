"""Scalar expressions of vectors and matrices, and their time derivatives."""
