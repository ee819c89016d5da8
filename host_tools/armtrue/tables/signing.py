"""Ed25519 keys (RFC 8032) and signatures over table images, by the firmware's own code."""

from __future__ import annotations

import base64
import binascii
import ctypes
import secrets
from pathlib import Path
from typing import Literal

from armtrue.errors import InputError
from armtrue.io.files import read_text, write_file
from armtrue.tables import layout
from armtrue.tables.fixed import library

KEY_LENGTH = 32
_HEAD = "armtrue-ed25519-{} "  # secret or public


def public_key(seed: bytes) -> bytes:
    """The public key (32 bytes) of a secret seed (32 bytes)."""
    result = ctypes.create_string_buffer(KEY_LENGTH)
    library().armtrue_ed25519_public_key(_checked(seed), result)
    return result.raw


def sign(seed: bytes, message: bytes) -> bytes:
    """The signature (64 bytes) of `message`."""
    result = ctypes.create_string_buffer(layout.SIGNATURE_LENGTH)
    library().armtrue_ed25519_sign(_checked(seed), message, ctypes.c_size_t(len(message)), result)
    return result.raw


def write_key_pair(path: Path) -> tuple[Path, bytes]:
    """Make a key pair: the secret in `path` (readable by its owner only), the public key in `path`.pub.

    Returns the public file and key. Errors: InputError where one of them is there already.
    """
    public_path = Path(f"{path}.pub")
    for place in (path, public_path):
        if place.exists():
            raise InputError(f"{place}: found a file, expected none: a key that is lost cannot be made again")
    seed = secrets.token_bytes(KEY_LENGTH)
    key = public_key(seed)
    write_file(path, _HEAD.format("secret") + base64.b64encode(seed).decode() + "\n")
    path.chmod(0o600)
    write_file(public_path, _HEAD.format("public") + base64.b64encode(key).decode() + "\n")
    return public_path, key


def read_key(path: Path, kind: Literal["secret", "public"]) -> bytes:
    """The secret seed or the public key in a file of `write_key_pair`. Errors: InputError."""
    text, head = read_text(path, largest_bytes=4096).strip(), _HEAD.format(kind)
    if text.startswith(head):
        try:
            key = base64.b64decode(text[len(head) :], validate=True)
        except binascii.Error:
            key = b""
        if len(key) == KEY_LENGTH:
            return key
    raise InputError(f"{path}: found something else, expected a {kind} key made by armtrue keygen")


def _checked(seed: bytes) -> bytes:
    if len(seed) != KEY_LENGTH:
        raise ValueError(f"expected {KEY_LENGTH} bytes, found {len(seed)}")
    return seed
