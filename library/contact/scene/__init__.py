"""Bodies that touch: laws, friction, who can touch whom."""
