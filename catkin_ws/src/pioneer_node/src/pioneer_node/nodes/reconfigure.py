"""A dynamic_reconfigure server for the configurations of this workspace.

The library's own server queries the ROS master once per parameter at startup and accepts unknown names and types. This
one takes names, defaults and bounds from the fields marked ``Live``, and writes all parameters in one call.
"""

import threading
from collections.abc import Callable, Mapping
from typing import Any

import rospy
from dynamic_reconfigure.msg import (
    BoolParameter,
    Config,
    ConfigDescription,
    DoubleParameter,
    Group,
    GroupState,
    IntParameter,
    ParamDescription,
    StrParameter,
)
from dynamic_reconfigure.srv import Reconfigure, ReconfigureRequest, ReconfigureResponse

from pioneer_node.core.live import LiveParameter, Value, accepted, live_parameters, live_values
from pioneer_node.nodes.parameter_server import set_parameters

_GROUP = "Default"
_RESTORE = "restore_defaults"
_CTYPES = {"int": "int", "str": "std::string", "double": "double", "bool": "bool"}


class ReconfigureServer:
    """The live parameters of one namespace.

    Publishes: ``<namespace>/parameter_descriptions`` (dynamic_reconfigure/ConfigDescription, latched),
        ``<namespace>/parameter_updates`` (dynamic_reconfigure/Config, latched).

    Services: ``<namespace>/set_parameters`` (dynamic_reconfigure/Reconfigure): sets the given values, clamped to their
        bounds, and returns the resulting values. ``restore_defaults`` restores the values from startup.

    Parameters: after a change all live parameters are written to ``<namespace>``.

    Threads: ``apply`` is called in the service's thread.

    On error: unknown names and wrong types are ignored and logged in one line; if ``apply`` raises, nothing changes
        and the client gets the reason.

    Args:
        namespace: absolute, or ``~`` and below.
        config: the current configuration.
        apply: applies the changed values; raises one of ``errors`` if it rejects them.
        errors: exceptions that ``apply`` raises for bad input.
    """

    def __init__(
        self,
        namespace: str,
        config: Any,
        apply: Callable[[dict[str, Value]], None],
        errors: tuple[type[Exception], ...] = (),
    ) -> None:
        self._namespace = rospy.resolve_name(namespace).rstrip("/")
        self._apply, self._errors = apply, errors
        self._parameters = live_parameters(type(config))
        self._values = self._initial = live_values(config)
        self._turn = threading.Lock()
        self._descriptions = rospy.Publisher(
            f"{self._namespace}/parameter_descriptions", ConfigDescription, queue_size=1, latch=True
        )
        self._updates = rospy.Publisher(
            f"{self._namespace}/parameter_updates", Config, queue_size=1, latch=True
        )
        self._descriptions.publish(_description(self._parameters))
        self._updates.publish(_message(self._values))
        self._service = rospy.Service(f"{self._namespace}/set_parameters", Reconfigure, self._set)

    def update(self, config: Any) -> None:
        """Sets the current configuration, whatever changed it, and publishes it if it differs."""
        values = live_values(config)
        if values != self._values:
            self._values = values
            self._tell()

    def close(self) -> None:
        """Unregisters the topics and the service."""
        self._service.shutdown("closed")
        self._descriptions.unregister()
        self._updates.unregister()

    def _set(self, request: ReconfigureRequest) -> ReconfigureResponse:
        with self._turn:
            changes, complaints = accepted(self._parameters, _values_from(request.config))
            for complaint in complaints:
                rospy.logerr("%s: %s", self._namespace, complaint)
            if changes.get(_RESTORE):
                changes = {**self._initial, _RESTORE: False}
            if any(self._values[name] != value for name, value in changes.items()):
                self._change(changes)
            return ReconfigureResponse(_message(self._values))

    def _change(self, changes: dict[str, Value]) -> None:
        try:
            self._apply(changes)
        except self._errors as error:
            rospy.logerr("%s", error)
            raise rospy.ServiceException(str(error)) from error

    def _tell(self) -> None:
        """Writes the current values to the parameter server and publishes them."""
        set_parameters({f"{self._namespace}/{name}": value for name, value in self._values.items()})
        self._updates.publish(_message(self._values))


def _values_from(message: Config) -> dict[str, Value]:
    return {
        each.name: each.value
        for each in (*message.bools, *message.ints, *message.strs, *message.doubles)
    }


def _message(values: Mapping[str, Value]) -> Config:
    message = Config(groups=[GroupState(_GROUP, True, 0, 0)])
    for name, value in values.items():
        if isinstance(value, bool):
            message.bools.append(BoolParameter(name, value))
        elif isinstance(value, int):
            message.ints.append(IntParameter(name, value))
        elif isinstance(value, float):
            message.doubles.append(DoubleParameter(name, value))
        else:
            message.strs.append(StrParameter(name, value))
    return message


def _description(parameters: tuple[LiveParameter, ...]) -> ConfigDescription:
    described = [
        ParamDescription(each.name, each.kind, 0, "", _enumeration(each)) for each in parameters
    ]
    return ConfigDescription(
        [Group(_GROUP, "", described, 0, 0)],
        _message({each.name: each.high for each in parameters}),
        _message({each.name: each.low for each in parameters}),
        _message({each.name: each.default for each in parameters}),
    )


def _enumeration(parameter: LiveParameter) -> str:
    """Returns the choices in the form that clients expect: the text of a Python dictionary."""
    if not parameter.choices:
        return ""
    ctype = _CTYPES[parameter.kind]
    constants = [
        {
            "name": name, "value": value, "type": parameter.kind, "description": "",
            "srcline": 0, "srcfile": "", "ctype": ctype, "cconsttype": f"const {ctype}",
        }
        for name, value in parameter.choices
    ]  # fmt: skip
    return repr({"enum": constants, "enum_description": ""})
