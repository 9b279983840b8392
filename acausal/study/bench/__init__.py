"""Speed against accuracy of any model, measured: `acausal bench`, `acausal.bench`, `simulate(accuracy=...)`."""
