#!/usr/bin/python3
"""Hands over to pioneer_description's xacro."""

import os
import sys

os.execvp("rosrun", ["rosrun", "pioneer_description", "xacro", *sys.argv[1:]])
