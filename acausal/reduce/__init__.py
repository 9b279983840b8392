"""What a scene does not need: the smallest model that gives the wanted outputs."""
