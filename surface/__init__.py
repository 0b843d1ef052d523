"""The geometry of depth maps: clouds, fused surfaces, and how far these are from the truth."""
