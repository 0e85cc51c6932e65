"""The studies are made with Galton, in a clone beside it; of Galton they use public names alone."""
