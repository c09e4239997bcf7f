"""``/tf``: publishes the transforms of all robots at a tick in one message."""

from collections.abc import Callable

from tf2_msgs.msg import TFMessage

from pioneer_gazebo import conversions
from pioneer_gazebo.nodes.topic import Topic


class TransformTopic:
    """Collects transforms and sends them together. Used from one thread."""

    def __init__(self, changed: Callable[[], None]) -> None:
        """Advertises ``/tf``; ``changed`` as in `Topic`."""
        self._topic = Topic("/tf", TFMessage, changed)
        self._transforms: list[bytes] = []

    @property
    def wanted(self) -> bool:
        """Whether there are subscribers."""
        return self._topic.wanted

    def add(self, transform: bytes) -> None:
        """Adds a serialised transform to the next message."""
        self._transforms.append(transform)

    def send(self) -> None:
        """Sends the collected transforms, if any."""
        if self._transforms:
            if self._topic.exchange is not None:
                for one in self._transforms:
                    self._topic.exchange.sample("/tf", one, conversions.name_of_transform(one))
            self._topic.write(conversions.transforms_frame(self._transforms))
            self._transforms.clear()
