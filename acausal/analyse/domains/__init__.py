"""Where expressions have a value: branches, relations and operations beyond their domain, and poles."""
