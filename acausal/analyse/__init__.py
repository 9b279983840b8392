"""The compiler's middle end, without CasADi: aliases, index reduction, states, blocks, events, the start problem."""
