"""The whole check of a tree file, with the robots and the scene that it names, before a run."""
