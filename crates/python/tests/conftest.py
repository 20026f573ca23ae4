"""What several tests use."""

import pytest

SCENE = """
[step]
dt = 0.002

[[body]]
name = "block"
layer = { box = [[-0.03, -0.03, -0.03], [0.03, 0.0, 0.03]], cells = [8, 4, 8] }
material = { young = 2e4, poisson = 0.45, density = 1000.0 }

[[body.core]]
name = "table"
bind = { box = [[-1.0, -1.0, -1.0], [1.0, -0.029, 1.0]] }

[tool]
sphere = 0.01
mass = 0.05
position = [0.0, 0.011, 0.0]

[coupling]
stiffness = 1000.0
damping = 10.0

[drive]
keys = [[0.0, 0.0, 0.011, 0.0], [0.05, 0.0, 0.004, 0.0]]
"""


@pytest.fixture(scope="session")
def scene() -> str:
    """A scene file: a sphere that is pressed into a soft block."""
    return SCENE
