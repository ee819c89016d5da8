# Transfers by a client that nobody here wrote (PyPI canopen): every size up to 512 bytes, then every 509th up to the largest table.
on_a_bus 1200 "$PY" tests/can/sweep_sizes.py
