"""Connection diagrams of models: who is connected with whom, laid out by ELK."""
