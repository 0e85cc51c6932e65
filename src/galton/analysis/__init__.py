"""From results to numbers and figures: statistics over runs, a comparison of losses, and how plots are drawn."""
