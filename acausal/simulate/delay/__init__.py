"""The past of a run: what was, for signals that are read later."""
