"""The moving entities, by name, by engine handle, and in the order of spawning."""

from collections.abc import Container

from pioneer_gazebo.core.entity import Entity
from pioneer_gazebo.core.error import ModelError

LONGEST_NAME = 200
"""Maximum length of a model name [characters]."""


class Roster:
    """The entities of a simulation."""

    def __init__(self) -> None:
        self.entities: list[Entity] = []  #: in the order of spawning; replaced, never modified in place
        self._by_name: dict[str, Entity] = {}
        self._by_handle: dict[int, Entity] = {}

    def check_name(self, name: str, taken: Container[str]) -> None:
        """Raises ModelError if the name is invalid or in use; ``taken`` holds the names of static models."""
        if not name or len(name) > LONGEST_NAME:
            raise ModelError(f"a model's name needs 1 to {LONGEST_NAME} characters, this has {len(name)}")
        if name in self._by_name or name in taken:
            raise ModelError(f"model {name} already exists")

    def add(self, entity: Entity) -> None:
        """Appends an entity."""
        entity.number = len(self.entities)
        self.entities = [*self.entities, entity]
        self._by_name[entity.name] = self._by_handle[entity.handle] = entity

    def remove(self, entity: Entity) -> None:
        """Removes an entity."""
        del self._by_name[entity.name], self._by_handle[entity.handle]
        self.entities = list(self._by_name.values())
        for number, other in enumerate(self.entities):
            other.number = number

    def names(self) -> list[str]:
        """Returns all names."""
        return list(self._by_name)

    def get(self, name: str) -> Entity | None:
        """Returns the entity of that name; None if there is none."""
        return self._by_name.get(name)

    def of_handle(self, handle: int) -> Entity:
        """Returns the entity with this engine handle."""
        return self._by_handle[handle]
