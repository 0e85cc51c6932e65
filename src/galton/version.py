"""The version, here alone: the wheel, `galton --version`, what Galton writes and the site take it from here."""

__version__ = "0.2.0.dev0"
