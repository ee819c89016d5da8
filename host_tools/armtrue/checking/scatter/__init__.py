"""Scatter of measurements: compared with sigma, over time, by rounding, and between reflectors of one tool."""
