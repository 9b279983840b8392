"""Where equations change, as data: relations of variables and of time, tables, sleeping rates."""
