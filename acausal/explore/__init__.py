"""Results to look at in a browser: a tree of signals, curves over each other, differences."""
