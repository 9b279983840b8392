"""Work-precision measurements of any model: `acausal bench`, `acausal.bench`, `simulate(accuracy=...)`."""
