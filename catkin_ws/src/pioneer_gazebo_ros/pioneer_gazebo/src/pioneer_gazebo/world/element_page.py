"""Writes the table of elements as the page ``docs/elements.md``.

``python -m pioneer_gazebo.world.element_page > docs/elements.md`` writes it again after a change of the table.
"""

# ruff: noqa: T201 - this module is run to print the page

from pioneer_gazebo.world.element_table import NAMED, QUIET, USED, rules

_HEAD = """# Elements of SDF and URDF

What the simulator does with each element of SDF 1.4 to 1.7 and of URDF. Elements that have no effect, and would have
one in Gazebo, are named when a world or robot is loaded: one line a kind, with file, line and how often. `./pioneer
check FILE` prints the same lines without a simulation.

- **used**: it has an effect.
- **named**: it has no effect here, and a warning names it. A value behind `=` is one with which it does nothing in
  Gazebo either: then it is not named. `mu` stands for the first friction coefficient beside it.
- **quiet**: it concerns looks, sound, Gazebo's window or its solver. Robots neither sense nor feel it.

`path/*` is an element with all that is in it. An element that is in none of the lists is named as unknown. A sensor
without a plugin, or of a kind that is not supported, is named as a whole. Elements of plugins are read by the plugins:
each that is not supported is named.

This page is written from the table in `pioneer_gazebo/world/element_table.py`, whose rows are tested against the
readers: a used element changes what is read, the others change nothing.
"""


def page() -> str:
    """Returns the page in Markdown."""
    parts = [_HEAD]
    for owner, table in rules().items():
        parts.append(f"\n## `<{owner.removeprefix('urdf ')}>`{_remark(owner)}\n")
        for status in (USED, NAMED, QUIET):
            names = [
                f"`{path}{'/*' if rule.is_branch else ''}{_idle(rule.idle)}`"
                for path, rule in table.items()
                if rule.status == status
            ]
            if names:
                parts.append(f"\n**{status}**:\n")
                parts += _wrapped(names)
    return "".join(parts)


def _remark(owner: str) -> str:
    if owner.startswith("urdf") or owner == "robot":
        return " of URDF"
    return " of URDF, without and with a link" if owner == "gazebo" else ""


def _idle(values: tuple[str, ...]) -> str:
    return f" = {' | '.join(values)}" if values else ""


def _wrapped(names: list[str]) -> list[str]:
    """Returns lines of at most 120 characters; a name is not divided."""
    lines = [""]
    for name in names:
        word = name if name is names[-1] else f"{name},"
        if lines[-1] and len(lines[-1]) + 1 + len(word) > 120:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return [f"{line}\n" for line in lines]


if __name__ == "__main__":
    print(page(), end="")
