"""How measurements scatter: against sigma and time, in steps of rounding, between reflectors of one tool."""
