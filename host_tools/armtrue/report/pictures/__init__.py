"""Charts, the arm in space and the pictures of effects, as SVG."""
