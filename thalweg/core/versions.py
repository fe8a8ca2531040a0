"""Version numbers of everything that results depend on, raised by hand when behaviour changes.

Each has a golden test (`tests/golden`) that fails when behaviour changes and the version does not. Changes of comments,
names or file locations raise no version. Compiled kernels and cached worlds are not results: they are keyed by the code
that made them.
"""

WORLD = 2
"""Worlds that `thalweg.world.build` makes of a level and a seed, or of a line."""
BANKS = 2
"""Banks of meadow, reeds and quay that are laid over such worlds, and the stone of quays in frames."""
RENDER = 3
"""Frames of a world at a pose, time and look."""
PROPS = 3
"""Props in frames: their shapes, places and classes, and the water around them."""
RULES = 1
"""Motion, progress, reward, cost and termination."""
FORCES = 1
"""Motion under wind, current and inertia, and the weather that a seed draws."""
TASKS = 1
"""What the tasks beside the paper's pay and cost, when they end, and what they add to the ideal eye."""
DEADLINES = 1
"""Where learning ends: returns and costs at the deadline of a task; costs also at the paper's step limit, if their
critics are told the share of steps. Trained policies of the tasks beside the paper's, and those with such critics,
depend on it."""
VEHICLES = 2
"""The boat: what it touches and pays for, its starts, its pilot, and what its ideal eye tells."""
PRIVILEGED = 2
"""The numbers of the ideal eye."""
PROPRIOCEPTION = 1
"""What a vehicle measures of itself."""
ENCODER = 1
"""Training of an encoder, and its codes of frames."""
TRAINING = 1
"""Collection of rollouts, and the training loop that all algorithms share."""
STEADY = 4
"""What the steady pilot gives to moves. Students learn from it, so that `IMITATION` rises with it."""
IMITATION = 5
"""What students learn from what their teacher gives to moves."""
EVALUATION = 1
"""Starts, conditions and flights of evaluated episodes, baselines included but for the steady pilot."""
SHIELD = 3
"""What the shield remembers of masks, which moves it vetoes, and by which it replaces them."""
ALGORITHMS = {
    "PPO": 3,
    "PPOLag": 3,
    "FOCOPS": 3,
    "P3O": 3,
    "OnCRPO": 3,
    "CPO": 3,
    "CUP": 3,
    "DDPGLag": 4,
    "TD3Lag": 4,
    "SACLag": 4,
    "SafeLOOP": 5,
    "CCEPETS": 4,
}
"""Updates of each algorithm, by its name in the registry."""
PACKAGED_ENCODER = 2
"""The encoder file that comes with the package."""
PACKAGED_GEOMETRY = 2
"""The file of the encoder of geometry that comes with the package."""
PACKAGED_GEOMETRY_TASKS = 1
"""The file of the encoder of geometry with objects of tasks that comes with the package."""
PACKAGED_POLICY = 4
"""The policy file of image and mask that comes with the package."""
PACKAGED_RGB_POLICY = 3
"""The policy file of the image alone that comes with the package."""
