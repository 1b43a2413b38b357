"""Adds to a CycloneDX list of Python packages the native libraries that their wheels carry.

Called by `release.sh sbom`, by the Python that has cyclonedx-bom.
"""

import argparse
import hashlib
import json
import re
import sys
from pathlib import Path

LICENCES = {
    "Apache-2.0": "openvino tbb",
    "BSD-2-Clause": "aom avif openjp2",
    "BSD-3-Clause": "hwloc openblas scipy_openblas sharpyuv vpx webp zstd",
    "FTL": "freetype",
    "GPL-3.0-or-later WITH GCC-exception-3.1": "gfortran gomp",
    "IJG AND BSD-3-Clause AND Zlib": "jpeg",
    "LGPL-2.1-or-later": "avcodec avformat avutil quadmath swresample swscale",
    "MIT": "brotli drm harfbuzz lcms2 nghttp2 proj Xau xcb",
    "OpenSSL": "crypto ssl",
    "blessing": "sqlite3",
    "curl": "curl",
    "libpng-2.0": "png16",
    "libtiff": "tiff",
    "0BSD": "lzma",
}
"""SPDX expression: the libraries' names without `lib`, or what these begin with."""
UNDECLARED = {
    "antlr4-python3-runtime": "BSD-3-Clause",
    "partd": "BSD-3-Clause",
    "qiskit-qasm3-import": "Apache-2.0",
}
"""Licences of Python packages that declare none in a form that a list can have."""
NAME = re.compile(r"lib(?P<name>[A-Za-z_0-9]+?)(?:-[0-9a-f]{8})*(?:-r0-[0-9a-f]+)?\W")


def licence(name: str) -> str:
    """The licence of a library, or the end."""
    for expression, names in LICENCES.items():
        if name.startswith(tuple(names.split())):
            return expression
    sys.exit(f"deploy/sbom.py: the licence of lib{name} is not known; add it to LICENCES")


def natives(environment: Path) -> list[dict[str, object]]:
    """A component for each native library in the folders that wheels have for them."""
    packages = next(environment.glob("lib/python*/site-packages"))
    found: list[dict[str, object]] = []
    for path in sorted(packages.glob("*.libs/*.so*")) + sorted(packages.glob("*/libs/*.so*")):
        match = NAME.match(path.name)
        name = match["name"] if match else path.name
        version = re.search(r"\.(\d[\w.]*?)(?:\.so)?$", path.name)
        place = str(path.relative_to(packages))
        found.append(
            {
                "type": "library",
                "bom-ref": place,
                "name": f"lib{name}",
                **({"version": version[1]} if version else {}),
                "hashes": [
                    {"alg": "SHA-256", "content": hashlib.sha256(path.read_bytes()).hexdigest()}
                ],
                "licenses": [{"expression": licence(name)}],
                "evidence": {"occurrences": [{"location": place}]},
            }
        )
    return found


def main() -> None:
    """Write the whole list, which has to be valid, to standard output."""
    from cyclonedx.schema import SchemaVersion
    from cyclonedx.validation.json import JsonStrictValidator

    parser = argparse.ArgumentParser()
    parser.add_argument("packages", type=Path, help="what cyclonedx-py wrote")
    parser.add_argument("environment", type=Path)
    parser.add_argument("version")
    options = parser.parse_args()
    bom = json.loads(options.packages.read_text())
    for package in bom["components"]:
        if not package.get("licenses"):
            if package["name"] not in UNDECLARED:
                sys.exit(f"deploy/sbom.py: {package['name']} has no licence; add it to UNDECLARED")
            package["licenses"] = [{"expression": UNDECLARED[package["name"]]}]
    bom["components"] += natives(options.environment)
    bom["metadata"]["component"] = {
        "type": "application",
        "bom-ref": "slipstream",
        "name": "slipstream",
        "version": options.version,
        "licenses": [{"license": {"id": "AGPL-3.0-only"}}],
    }
    text = json.dumps(bom, indent=1, sort_keys=True)
    fault = JsonStrictValidator(SchemaVersion.from_version(bom["specVersion"])).validate_str(text)
    if fault is not None:
        sys.exit(f"deploy/sbom.py: not valid: {fault}")
    print(text)


if __name__ == "__main__":
    main()
