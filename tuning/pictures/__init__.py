"""One style for figures, and the page that carries them."""
