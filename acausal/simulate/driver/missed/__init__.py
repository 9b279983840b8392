"""The search for what a steep function does between two rows of a solution."""
