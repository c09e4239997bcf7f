"""Each row of the table in docs/differences.md names the test that covers it, and this test exists."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
TABLE = (
    (ROOT / "docs" / "differences.md")
    .read_text()
    .split("## What the original could not do")[1]
    .split("\n## ")[0]
)
ROWS = [
    [cell.strip() for cell in line.split("|")[1:-1]]
    for line in TABLE.splitlines()
    if line.startswith("|")
][2:]


def test_every_row_names_a_test_that_exists() -> None:
    files = [*ROOT.glob("catkin_ws/src/**/test/**/*"), *ROOT.glob("tools/test/**/*")]
    functions = "\n".join(
        path.read_text() for path in files if path.suffix == ".py" and path.name.startswith("test_")
    )
    paths = [str(path) for path in files]
    assert len(ROWS) > 20
    for row in ROWS:
        assert len(row) == 3, row
        named = re.findall(r"`([\w./]*(?:test_\w+|\.test|/)[\w.]*)`", row[2])
        assert named, f"nothing holds: {row[0]}"
        for name in named:
            file = "." in name or name.endswith("/")
            known = (
                any(f"/{name}" in path for path in paths) if file else f"def {name}(" in functions
            )
            assert known, f"there is no {name}, which is to hold: {row[0]}"
