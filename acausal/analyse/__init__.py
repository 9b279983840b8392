"""The compiler's middle end, free of CasADi: aliases, index reduction, states, blocks, events and starts as data."""
