"""The custom rules file of a gateway, which may be missing."""

import logging
from collections.abc import Mapping
from typing import Any

import yaml

from rocon_gateway.core.config import with_custom_rules
from rocon_gateway.core.error import ConfigError


def with_rules_file(parameters: Mapping[str, Any], logger: logging.Logger) -> dict[str, Any]:
    """Returns a node's parameters with those of the file that ``custom_rules_file`` names; without one, as they are.

    Raises:
        ConfigError: the file is no YAML, or holds no mapping.
    """
    path = parameters.get("custom_rules_file")
    if not path:
        return dict(parameters)
    try:
        with open(path, encoding="utf-8") as file:
            return with_custom_rules(parameters, yaml.safe_load(file))
    except OSError as error:
        logger.warning("the custom rules file is left out: %s", error)
        return dict(parameters)
    except yaml.YAMLError as error:
        raise ConfigError(f"gateway: {path} is not YAML: {error}") from None
