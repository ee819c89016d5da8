"""python sweep_sizes.py [DENSE [STEP]]: PyPI canopen's segmented transfers, size by size, there and back.

Every size up to DENSE (512), then every STEP-th (509, which meets every remainder of seven) up to the largest
table. DENSE 16384 is every size: some hours in User-Mode Linux. Run where there is a bus (./dev bench sizes).
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent / "support"))

from node_process import NodeProcess, connect, disconnect


def main() -> int:
    """Sweep; exit status 1 at the first size that does not come back as it was sent."""
    dense = int(sys.argv[1]) if len(sys.argv) > 1 else 512
    step = int(sys.argv[2]) if len(sys.argv) > 2 else 509
    with tempfile.TemporaryDirectory() as state, NodeProcess(Path(state)):
        node = connect()
        capacity = node.sdo["Table status"]["Capacity (bytes)"].raw
        sizes = [*range(1, min(dense, capacity) + 1), *range(dense + step, capacity + 1, step), capacity]
        begin = time.monotonic()
        for size in sizes:
            image = bytes((7 * k + size) % 251 for k in range(size))
            node.sdo.download(0x2010, 0, image)
            if node.sdo.upload(0x2010, 0) != image:
                print(f"{size} bytes came back otherwise")
                return 1
        took_s = time.monotonic() - begin
        disconnect(node)
    frames = sum(4 * -(-size // 7) + 4 for size in sizes)
    print(f"{len(sizes)} sizes from 1 to {sizes[-1]} bytes, {frames} frames, {took_s:.0f} s: all as sent")
    return 0


if __name__ == "__main__":
    sys.exit(main())
