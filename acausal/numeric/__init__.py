"""Numbers for expressions at sample points."""
