"""Loads the custom rules file of a gateway. The file is optional."""

import logging
from collections.abc import Mapping
from typing import Any

import yaml

from rocon_gateway.error import ConfigError
from rocon_gateway.node.config import with_custom_rules


def with_rules_file(parameters: Mapping[str, Any], logger: logging.Logger) -> dict[str, Any]:
    """Returns a node's parameters merged with those in ``custom_rules_file``; unchanged if there is no such file.

    Raises:
        ConfigError: the file is not YAML, or not a mapping.
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
