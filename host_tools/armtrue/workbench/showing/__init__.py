"""The page and its pieces, as HTML."""
