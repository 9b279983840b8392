"""Functions evaluated by columns: each instruction for all equal parts together."""
