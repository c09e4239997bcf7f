"""Reads `.concert` files: `<concert>` with `<arg>` and `<launch>` elements.

An `<arg>` has a name and exactly one of `default` and `value`; the command line overrides both. A `<launch>` has the
`name` of a launch file, its `package` (without one, `name` is a path), a `port` for its ROS master, a `title`, and
`<arg name= value=>` children. `respawn` and `required` (`true` or `false`) define what happens when it ends.
Substitutions (`$(arg x)`, `$(find pkg)`, `$(env X)`, `$(optenv X y)`) are resolved by a function that the caller
passes.
"""

import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from rocon_launch.error import ConcertError

Substitute = Callable[[str, Mapping[str, str]], str]
"""Resolves the substitutions in a text, given the arguments defined so far."""

SHORT_LIFE = 10.0
"""A launch that ends sooner than this after its start would fail again, such as a hub whose port is in use [s]."""


@dataclass(frozen=True)
class Launch:
    """One roslaunch to run."""

    package: str  #: package of the launch file; empty if `name` is a path
    name: str  #: the launch file
    port: int  #: the port of its ROS master
    title: str  #: prefix of its output lines
    arguments: Mapping[str, str]  #: its arguments, by name
    waits: bool = False  #: whether an earlier launch starts the master on that port
    respawn: bool = False  #: whether to restart it when it ends
    required: bool = False  #: whether its end stops the whole concert

    def starts_again(self, lived: float) -> bool:
        """Returns whether to restart it after it has ended by itself, having run for ``lived`` seconds."""
        return self.respawn and lived >= SHORT_LIFE

    def ends_all(self, lived: float) -> bool:
        """Returns whether its end stops the whole concert. A ``respawn`` launch that fails at once is not retried."""
        return self.required or (self.respawn and lived < SHORT_LIFE)


def launches_from_text(
    text: str, mappings: Mapping[str, str], default_port: int, substitute: Substitute
) -> list[Launch]:
    """Returns the launches of a .concert file, in order.

    Args:
        text: the content of the file.
        mappings: `arg:=value` from the command line.
        default_port: port for a launch without `port`.
        substitute: resolves substitutions.

    Raises:
        ConcertError: the text is not a valid .concert file, or `mappings` has an argument that it does not define.
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
        raise ConcertError(
            f"there is no argument '{unknown[0]}'; there are {', '.join(sorted(arguments)) or 'none'}"
        )
    return launches


def _name(element: ET.Element) -> str:
    name = element.get("name")
    if not name:
        raise ConcertError(f"an <{element.tag}> has no name")
    return name


def _argument(
    element: ET.Element,
    mappings: Mapping[str, str],
    arguments: Mapping[str, str],
    substitute: Substitute,
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
