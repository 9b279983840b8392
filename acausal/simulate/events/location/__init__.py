"""Where between two instants a guard crosses zero."""
