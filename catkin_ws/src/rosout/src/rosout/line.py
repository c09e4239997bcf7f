"""The form of a message in the log file."""

from rosgraph_msgs.msg import Log

LEVELS = {
    Log.DEBUG: "DEBUG",
    Log.INFO: "INFO",
    Log.WARN: "WARN",
    Log.ERROR: "ERROR",
    Log.FATAL: "FATAL",
}


def line_of(message: Log, with_topics: bool = True) -> str:
    """Returns a message as ROS' own rosout writes it, without the line's end."""
    stamp = f"{message.header.stamp.secs}.{message.header.stamp.nsecs:09d}"
    level = LEVELS.get(message.level, str(message.level))
    place = f"[{message.file}:{message.line}({message.function})]"
    fields = [stamp, level, message.name, place]
    if with_topics:
        fields.append(f"[topics: {', '.join(message.topics)}]")
    return " ".join([*fields, message.msg])
