"""The recorded rows of a run, and their corrections and checks before they become a result."""
