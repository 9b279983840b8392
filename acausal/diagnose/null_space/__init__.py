"""What the numbers of a singular system leave open, and what they state twice."""
