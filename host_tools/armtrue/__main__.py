"""`python -m armtrue`: the same as the command `armtrue`."""

from armtrue.cli import main

main()
