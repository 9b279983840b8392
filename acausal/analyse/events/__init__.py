"""Causes of events: relations of variables and of time, tables, and kinks that a solver must not step over."""
