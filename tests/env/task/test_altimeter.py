"""The altimeter: heights above the water under the vehicle, as the rules measure them."""

import numpy as np
import pytest

from tests.env.handmade import canal
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.task.altimeter import heights_above_water


def test_heights_are_above_the_level_under_the_vehicle():
    level = np.linspace(3.0, 0.0, 61)  # falls by 5 cm a metre
    env = RiverVectorEnv([canal(60.0, level_m=level)], 2, EnvConfig(observation="none"))
    env.reset(seed=0, options={"pose": np.array([[10.0, 1.0, 7.0, 0.0], [40.0, -1.0, 2.0, 0.0]])})
    assert heights_above_water(env.courses, env.state) == pytest.approx([7.0 - 2.5, 2.0 - 1.0])
    env.step(np.array([[1, 1, 0, 1], [0, 1, 0, 1]]))
    assert heights_above_water(env.courses, env.state) == pytest.approx([4.55, 2.05])
