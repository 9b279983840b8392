"""Cache of compiled models by structure, in memory and on disk."""
