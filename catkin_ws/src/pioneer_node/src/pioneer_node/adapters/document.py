"""Reads YAML documents and keeps the line number of every field and item."""

from pathlib import Path
from typing import Any, TypeVar

import yaml

from pioneer_node.core.document import DocumentError, Place, built

Kind = TypeVar("Kind")


def read_document(kind: type[Kind], path: Path) -> Kind:
    """Returns a YAML file's content as the dataclass ``kind``; see `built`.

    Raises:
        DocumentError: the file cannot be read or is invalid; the message begins with file and line.
    """
    content, lines = read_content(path)
    try:
        return built(kind, content)
    except DocumentError as error:
        raise located(error, path, lines) from None


def read_content(path: Path) -> tuple[Any, dict[Place, int]]:
    """Returns a YAML file's content and the line number of each field and item.

    Raises:
        DocumentError: the file cannot be read, is not YAML, or contains a field twice.
    """
    try:
        loader = yaml.SafeLoader(path.read_text())
        root = loader.get_single_node()
        content = None if root is None else loader.construct_document(root)
        lines: dict[Place, int] = {(): 1}
        if root is not None:
            _note_lines(root, (), lines, path)
        return content, lines
    except RecursionError:
        raise DocumentError(f"{path}: a value contains itself") from None
    except OSError as error:
        raise DocumentError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise DocumentError(f"{path}: cannot be read: {error}") from None
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise DocumentError(f"{path}:{line}: invalid YAML: {error.problem}") from None
    except yaml.YAMLError as error:
        raise DocumentError(f"{path}: invalid YAML: {error}") from None


def located(error: DocumentError, path: Path, lines: dict[Place, int]) -> DocumentError:
    """Returns the error with file and line prepended; if its place has no line, that of the closest enclosing value."""
    place = error.place
    while place not in lines:
        place = place[:-1]
    return DocumentError(f"{path}:{lines[place]}: {error}", *error.place)


def _note_lines(node: yaml.Node, place: Place, lines: dict[Place, int], path: Path) -> None:
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            own = (*place, key.value)
            if own in lines:
                raise DocumentError(
                    f"{path}:{key.start_mark.line + 1}: field {key.value} is given twice"
                )
            lines[own] = key.start_mark.line + 1
            _note_lines(value, own, lines, path)
    elif isinstance(node, yaml.SequenceNode):
        for number, value in enumerate(node.value):
            lines[*place, number] = value.start_mark.line + 1
            _note_lines(value, (*place, number), lines, path)
