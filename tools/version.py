"""Checks that all package.xml files and CHANGELOG.md have the version in ``VERSION``."""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def other_versions(root: Path) -> list[str]:
    """Returns one line for each file under ``root`` with a version other than that in its ``VERSION``."""
    version = (root / "VERSION").read_text().strip()
    found = [
        (path, match.group(1) if (match := re.search(r"<version>(.*)</version>", path.read_text())) else "none")
        for path in sorted((root / "catkin_ws" / "src").rglob("package.xml"))
    ]
    changelog = root / "CHANGELOG.md"
    released = re.findall(r"^## (\d\S*)", changelog.read_text(), re.MULTILINE)
    found.append((changelog, released[0] if released else "none"))
    return [
        f"{path.relative_to(root)}: version {other}, VERSION says {version}"
        for path, other in found
        if other != version
    ]


if __name__ == "__main__":
    lines = other_versions(ROOT)
    print("\n".join(lines))
    sys.exit(bool(lines))
