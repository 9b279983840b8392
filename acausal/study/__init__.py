"""Studies of whole models: speed against accuracy, stability, parameter fits, sweeps and reduction."""
