"""A participant of a ROS 2 network: publishes the topic /NAME, and prints all topics that it knows.

ros_discovering.py NAME        prints one JSON list for every line that it reads
"""

import json
import sys

from haptigraph.errors import BadInput
from haptigraph.ros2.node import Node
from haptigraph.ros2.types import String


def main():
    try:
        node = Node()
    except BadInput as error:
        sys.exit(str(error))
    node.publisher(f"/{sys.argv[1]}", String)
    for _ in sys.stdin:
        sys.stdout.write(json.dumps(list(node.published())) + "\n")
        sys.stdout.flush()
    node.close()


if __name__ == "__main__":
    main()
