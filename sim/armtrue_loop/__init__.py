"""The loop closed in software: controller, compensator, drives, arm and tracker on a CAN bus.

`python -m armtrue_loop SCENARIO --out DIR` (inside the rig: `./dev sil`) measures an arm with hidden
errors over CAN, fits it, finds what is missing, exports and uploads the tables over CAN, and measures
again. Controller: PyPI canopen and its profiles.p402. Truth: armtrue_sim, in a process of its own.
"""
