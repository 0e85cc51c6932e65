"""What is studied with Galton, in a clone beside it; of Galton it uses public names alone."""
