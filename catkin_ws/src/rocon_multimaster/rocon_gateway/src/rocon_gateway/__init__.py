"""The gateway: rules describe the desired state, a relay carries the topics.

``GatewayError``, ``GatewaySampleRuntimeError``, ``Graph`` and ``samples`` exist for the tests of rocon's gateway. They
are loaded on first use, because they need rospy and most of this package does not.
"""

import importlib

_PLACES = {
    "GatewayError": ("error", "GatewayError"),
    "GatewaySampleRuntimeError": ("commands.samples", "GatewaySampleRuntimeError"),
    "Graph": ("commands.graph", "Graph"),
    "samples": ("commands.samples", ""),
}


def __getattr__(name: str) -> object:
    """Loads and returns one of the names above."""
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    place, attribute = _PLACES[name]
    module = importlib.import_module(f"{__name__}.{place}")
    return getattr(module, attribute) if attribute else module
