"""Requests rules from this master's gateway, after waiting for the gateway and its hub."""

from collections.abc import Callable, Iterable, Sequence

import rosgraph
import rospy
from gateway_msgs import msg, srv

from rocon_flip.rule_set import Action, Wish

_EXISTS = {
    Action.ADVERTISE: msg.ErrorCodes.ADVERTISEMENT_EXISTS,
    Action.PULL: msg.ErrorCodes.PULL_RULE_ALREADY_EXISTS,
    Action.FLIP: msg.ErrorCodes.FLIP_RULE_ALREADY_EXISTS,
}


class GatewayClient:
    """Client of this master's gateway.

    Args:
        namespace: the gateway node's name.
    """

    def __init__(self, namespace: str = "/gateway") -> None:
        self._namespace = namespace
        self._info: msg.GatewayInfo | None = None
        self._subscriber = rospy.Subscriber(
            f"{namespace}/gateway_info", msg.GatewayInfo, self._take, queue_size=1
        )

    def _take(self, info: msg.GatewayInfo) -> None:
        self._info = info

    def wait(self) -> None:
        """Waits until the gateway is running and connected to a hub. Raises ROSInterruptException at shutdown."""
        where = f"{self._namespace} on the master {rosgraph.get_master_uri()}"
        self._wait_for(lambda: self._info is not None, f"Waiting for the gateway {where} …")
        self._wait_for(self._is_connected, "Waiting for the gateway to reach its hub …")

    def _is_connected(self) -> bool:
        return self._info is not None and self._info.connected

    def _wait_for(self, condition: Callable[[], bool], words: str) -> None:
        told = False
        while not condition():
            if not told:
                rospy.loginfo(words)
                told = True
            if rospy.is_shutdown():
                raise rospy.ROSInterruptException("shutdown")
            rospy.rostime.wallsleep(0.05)

    def ask(self, action: Action, wishes: Sequence[Wish], cancel: bool = False) -> bool:
        """Requests all `wishes` in one call; returns whether they are now active (or, with `cancel`, removed).

        A rule that already exists is logged in one line and counts as success.
        """
        wishes = list(wishes) if cancel else self._new(action, wishes)
        if not wishes:
            return True
        for wish in wishes:
            rospy.loginfo("%s%s: [%s]", "Cancel " if cancel else "", action.capitalize(), wish)
        result, message = self._call(action, wishes, cancel)
        if result == _EXISTS[action] and len(wishes) > 1:
            # Another client requested one of them at the same moment: still request the others.
            answers = [self.ask(action, [wish]) for wish in wishes]
            return all(answers)
        if result == _EXISTS[action]:
            self._say_exists(action, wishes[0])
            return True
        if result:
            rospy.logerr("%s: %s (%d)", action.capitalize(), message, result)
        return result == msg.ErrorCodes.SUCCESS

    def _new(self, action: Action, wishes: Iterable[Wish]) -> list[Wish]:
        known = self._known(action)
        new = []
        for wish in wishes:
            if wish in known:
                self._say_exists(action, wish)
            else:
                new.append(wish)
        return new

    def _say_exists(self, action: Action, wish: Wish) -> None:
        rospy.loginfo("%s: [%s] already exists and stays active", action.capitalize(), wish)

    def _known(self, action: Action) -> set[Wish]:
        if self._info is None:
            return set()
        if action == Action.ADVERTISE:
            return {Wish(rule.type, rule.name, rule.node) for rule in self._info.public_watchlist}
        remotes = self._info.pull_watchlist if action == Action.PULL else self._info.flip_watchlist
        return {Wish(one.rule.type, one.rule.name, one.rule.node, one.gateway) for one in remotes}

    def _call(self, action: Action, wishes: Sequence[Wish], cancel: bool) -> tuple[int, str]:
        rules = [msg.Rule(wish.kind, wish.name, wish.node) for wish in wishes]
        try:
            if action == Action.ADVERTISE:
                answer = self._service(action, srv.Advertise)(cancel=cancel, rules=rules)
            else:
                remotes = [
                    msg.RemoteRule(wish.gateway, rule)
                    for wish, rule in zip(wishes, rules, strict=True)
                ]
                answer = self._service(action, srv.Remote)(remotes=remotes, cancel=cancel)
        except rospy.ServiceException as error:
            return msg.ErrorCodes.HUB_UNKNOWN_ERROR, f"the gateway did not answer: {error}"
        return answer.result, answer.error_message

    def _service(self, action: Action, kind: type) -> rospy.ServiceProxy:
        name = f"{self._namespace}/{action}"
        rospy.wait_for_service(name)
        return rospy.ServiceProxy(name, kind)
