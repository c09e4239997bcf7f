"""Patrols on disk."""

from pathlib import Path

import yaml

from simple_navigation_goals.core.error import PatrolError
from simple_navigation_goals.core.patrol import Patrol, patrol_from_mapping


def read_patrol(path: Path, frame: str) -> Patrol:
    """Returns the patrol in the YAML file at ``path``; ``frame`` applies unless the file names another.

    Raises:
        PatrolError: the file is missing, not YAML, or not a patrol; the message is one line that names the file.
    """
    try:
        return patrol_from_mapping(yaml.safe_load(path.read_text()), frame)
    except OSError as error:
        raise PatrolError(f"cannot read the patrol {path}: {error.strerror}") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise PatrolError(f"the patrol {path} is not valid YAML: {' '.join(str(error).split())}") from None
    except PatrolError as error:
        raise PatrolError(f"the patrol {path}: {error}") from None
