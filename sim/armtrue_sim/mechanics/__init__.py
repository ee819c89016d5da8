"""What holds of any arm: transforms, kinematic chains, gravity loads, the four-bar linkage, expressions."""
