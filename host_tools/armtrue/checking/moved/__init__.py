"""What changed half way: the tracker or the base was moved, or the reflector was exchanged."""
