"""The exhibits of docs/stability-gallery.md: every method that is shown to fail is run."""
