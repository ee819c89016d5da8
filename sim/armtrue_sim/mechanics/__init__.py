"""Mechanics of an arm: transforms, kinematic chains, gravity loads, the four-bar linkage; and the expression parser."""
