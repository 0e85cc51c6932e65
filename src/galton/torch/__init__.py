"""The losses for PyTorch: a distribution that any PPO or A2C takes, and critics that classify. No JAX is imported."""

from galton.extras import needed

with needed("galton.torch", "torch"):
    from galton.torch.critics import classification_loss as classification_loss
    from galton.torch.critics import value_of as value_of
    from galton.torch.histogram import Histogram as Histogram
    from galton.torch.initial import first_logits as first_logits
    from galton.torch.initial import initialize_ as initialize_
