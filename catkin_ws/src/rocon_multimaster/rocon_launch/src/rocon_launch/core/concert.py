"""Reading `.concert` files: `<concert>` with `<arg>` and `<launch>` elements.

An `<arg>` has a name and exactly one of `default` and `value`; both give way to the command line. A `<launch>` has
a `name` (of a launch file), a `package` that it is in (or `name` is a path), a `port` for its ROS master, a
`title`, and `<arg name= value=>` children; `respawn` and `required`, `true` or `false`, say what its end means.
Substitutions (`$(arg x)`, `$(find pkg)`, `$(env X)`, `$(optenv X y)`) are the caller's: the reader is given a function
for them.
"""

import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from rocon_launch.core.error import ConcertError

Substitute = Callable[[str, Mapping[str, str]], str]
"""Resolves the substitutions in a text, given the arguments so far."""

SHORT_LIFE = 10.0
"""What ends sooner than this after its start [s], such as a hub whose port is taken, would end again."""


@dataclass(frozen=True)
class Launch:
    """One roslaunch to run."""

    package: str  #: where the launch file is; empty if `name` is a path
    name: str  #: the launch file
    port: int  #: the port of its ROS master
    title: str  #: what its lines of output begin with
    arguments: Mapping[str, str]  #: its arguments, by name
    waits: bool = False  #: whether an earlier one starts the master on that port
    respawn: bool = False  #: whether it is started again when it ends
    required: bool = False  #: whether its end is the end of all

    def starts_again(self, lived: float) -> bool:
        """Returns whether it is to be started again after it ended by itself, having run for ``lived`` seconds."""
        return self.respawn and lived >= SHORT_LIFE

    def ends_all(self, lived: float) -> bool:
        """Returns whether that was the end of the whole concert: one that cannot stay is not tried for ever."""
        return self.required or (self.respawn and lived < SHORT_LIFE)


def launches_from_text(
    text: str, mappings: Mapping[str, str], default_port: int, substitute: Substitute
) -> list[Launch]:
    """Returns the launches of a .concert file, in order.

    Args:
        text: the file's content.
        mappings: `arg:=value` of the command line.
        default_port: for a launch without `port`.
        substitute: resolves substitutions.

    Raises:
        ConcertError: the text is not such a file, or `mappings` names an argument that it does not have.
    """
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise ConcertError(f"not XML: {error}") from None
    if root.tag != "concert":
        raise ConcertError(f"the root is <{root.tag}>, not <concert>")
    arguments: dict[str, str] = {}
    launches: list[Launch] = []
    for element in root:
        if element.tag == "arg":
            arguments[_name(element)] = _argument(element, mappings, arguments, substitute)
        elif element.tag == "launch":
            launches.append(_launch(element, arguments, default_port, substitute, launches))
        else:
            raise ConcertError(f"<{element.tag}> is neither <arg> nor <launch>")
    unknown = sorted(set(mappings) - set(arguments))
    if unknown:
        raise ConcertError(f"there is no argument '{unknown[0]}'; there are {', '.join(sorted(arguments)) or 'none'}")
    return launches


def _name(element: ET.Element) -> str:
    name = element.get("name")
    if not name:
        raise ConcertError(f"an <{element.tag}> has no name")
    return name


def _argument(
    element: ET.Element, mappings: Mapping[str, str], arguments: Mapping[str, str], substitute: Substitute
) -> str:
    name, default, value = _name(element), element.get("default"), element.get("value")
    if (default is None) == (value is None):
        raise ConcertError(f"argument '{name}' needs exactly one of default and value")
    return mappings[name] if name in mappings else substitute(default or value or "", arguments)


def _launch(
    element: ET.Element,
    arguments: Mapping[str, str],
    default_port: int,
    substitute: Substitute,
    earlier: list[Launch],
) -> Launch:
    name = substitute(_name(element), arguments)
    port = _port(substitute(element.get("port", str(default_port)), arguments), name)
    nested = {}
    for child in element:
        if child.tag != "arg" or child.get("value") is None:
            raise ConcertError(f"launch '{name}' may hold only <arg name= value=>")
        nested[_name(child)] = substitute(child.get("value", ""), arguments)
    respawn, required = (_flag(element, key, name) for key in ("respawn", "required"))
    if respawn and required:
        raise ConcertError(f"launch '{name}' cannot be both respawn and required")
    return Launch(
        package=substitute(element.get("package", ""), arguments),
        name=name,
        port=port,
        title=substitute(element.get("title", f"rocon_launch:{port}"), arguments),
        arguments=nested,
        waits=any(one.port == port for one in earlier),
        respawn=respawn,
        required=required,
    )


def _flag(element: ET.Element, key: str, name: str) -> bool:
    text = element.get(key, "false")
    if text not in ("true", "false"):
        raise ConcertError(f"launch '{name}': {key} must be true or false, not '{text}'")
    return text == "true"


def _port(text: str, name: str) -> int:
    if not text.isdigit() or not 0 < int(text) < 65536:
        raise ConcertError(f"launch '{name}': '{text}' is not a port")
    return int(text)
