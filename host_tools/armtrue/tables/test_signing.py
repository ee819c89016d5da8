"""Keys and signatures: the C library reads 32 bytes of seed, so a shorter one must not reach it."""

from __future__ import annotations

import pytest

from armtrue.tables.signing import KEY_LENGTH, public_key, sign


@pytest.mark.parametrize("length", [0, KEY_LENGTH - 1, KEY_LENGTH + 1])
def test_seed_of_another_length_is_refused(length: int) -> None:
    seed = bytes(length)
    with pytest.raises(ValueError, match=f"expected 32 bytes, found {length}"):
        public_key(seed)
    with pytest.raises(ValueError, match=f"expected 32 bytes, found {length}"):
        sign(seed, b"image")
