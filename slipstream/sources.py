"""A digest of installed sources, by which two machines or two runs know the same code."""

from __future__ import annotations

from collections.abc import Collection
from hashlib import sha256
from importlib.resources import files
from pathlib import Path


def sources_digest(packages: Collection[str], excluded: Collection[str] = ()) -> str:
    """SHA-256 of all modules of packages, hexadecimal.

    Args:
        packages: in the order in which they count.
        excluded: parts that are left out, as ``package/part``.
    """
    digest = sha256()
    for package in packages:
        root = Path(str(files(package)))
        for path in sorted(root.rglob("*.py")):
            inside = path.relative_to(root)
            if f"{package}/{inside.parts[0]}" not in excluded:
                digest.update(f"{package}/{inside.as_posix()}\n".encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()
