"""The base mesh, its atlas, and what is done to meshes: refined, cut, smoothed, measured."""
