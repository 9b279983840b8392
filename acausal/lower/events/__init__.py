"""CasADi functions of events: relations, event rounds, impulses."""
