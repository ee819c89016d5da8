"""Changes during a session: the tracker or the base was moved, or the reflector was exchanged."""
