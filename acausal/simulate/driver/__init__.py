"""The driver of a run: from stop to stop of its agenda, in Python and in compiled code."""
