"""A node for the tests of `node_host`: it forwards words with its name, a gain and the ROS time."""

import threading

from std_msgs.msg import String
from std_srvs.srv import SetBool, SetBoolResponse

from pioneer_node.core.parameter import ParameterError


class Echo:
    def __init__(self, node):
        self.node, self.gain, self.watched = node, node.parameters().get("gain", 1), None
        if self.gain == "much":
            raise ParameterError("~gain is 'much', not a number")
        node.watch("shared", self.take)
        self.publisher = node.advertise("~said", String, latch=True)
        node.subscribe("words", String, self.hear)
        node.serve("~switch", SetBool, self.switch)
        node.serve("~gate", SetBool, self.pass_gate, may_wait=True)
        self.gate = threading.Event()
        self.ticker = node.every(0.01, self.tick)
        node.logger.warning("made with gain %s", self.gain)

    def take(self, value):
        self.watched = value

    def hear(self, message, sender):
        if message.data == "tick":
            self.ticker.start()
        if message.data == "fail":
            raise RuntimeError("as asked")
        self.publisher.publish(
            f"{message.data} x{self.gain} of {sender} at {self.node.now():.2f}, {self.watched}"
        )

    def tick(self):
        self.publisher.publish("ticked")
        self.ticker.stop()

    def pass_gate(self, request):
        if request.data:
            self.gate.wait(60)
        self.gate.set()
        return SetBoolResponse(True, "passed")

    def switch(self, request):
        if not request.data:
            raise ValueError("it stays on")
        return SetBoolResponse(True, self.node.resolved("words"))


# `advertise` publishes messages; here, a word is turned into one.
def build(node):
    echo = Echo(node)
    publish = echo.publisher.publish
    echo.publisher.publish = lambda text: publish(String(text))
    return echo
