"""Test of the syntax of the ROS 2 node, which nothing here can run."""

import ast
from pathlib import Path

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "ros2_follow.py"


def test_the_node_compiles_and_says_that_no_robot_has_run_it():
    source = EXAMPLE.read_text()
    compile(source, str(EXAMPLE), "exec")
    assert "checked for its syntax only" in (ast.get_docstring(ast.parse(source)) or "")
