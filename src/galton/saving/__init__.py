"""How files of Galton's are written and read: whole or not at all, and with what made them."""
