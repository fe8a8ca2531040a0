"""Settings of an imitation."""

from typing import Literal

from pydantic import NonNegativeInt, PositiveFloat, PositiveInt

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.common.setting_types import LayerSize, OptionalLayerSize
from thalweg.algos.policy.networks import NetworkShape
from thalweg.algos.policy.vision import Eyes
from thalweg.core.config import FiniteNonNegative, FinitePositive, Fraction, TupleOf, frozen_config

Sight = Literal["rgb+mask", "rgb", "mask"]
Teacher = Literal["steady", "scripted"]
CHANNELS: dict[str, int] = {"rgb+mask": 4, "rgb": 3, "mask": 1}
IMAGE_PX = 128


@frozen_config(AlgorithmError)
class ImitationConfig:
    """Settings of DAgger (Ross, Gordon, Bagnell 2011) into a policy with convolutions and a recurrent memory."""

    observation: Sight = "rgb+mask"
    """What the student sees, 128x128: the image and the water mask, or one of them."""
    teacher: Teacher = "steady"
    """The pilot that is imitated: `steady`, which gives every move its worth, or `scripted`, of which only the one move
    that it would make is known."""
    filters: TupleOf[LayerSize] = (16, 32, 64, 64)
    """Filters of each convolution."""
    features: LayerSize = 256
    """Numbers that the convolutions make of a frame."""
    memory_size: OptionalLayerSize = 128
    """Size of the recurrent state; 0: no memory."""
    hidden: TupleOf[LayerSize] = (128,)
    """Sizes of the hidden layers behind the memory."""
    sequence: PositiveInt = 32
    """Steps that are flown between two updates; gradients go back through as many."""
    sequences_per_batch: PositiveInt = 4
    """Sequences of a gradient step."""
    replay: FiniteNonNegative = 1.0
    """Stored sequences that are drawn anew, under other looks, for each new one."""
    capacity: PositiveInt = 200_000
    """Stored steps, the latest ones; 0.5 kB each."""
    learning_rate: FinitePositive = 1e-3
    """Learning rate of Adam; it falls linearly to a twentieth."""
    max_grad_norm: PositiveFloat = 1.0
    """Largest norm of a gradient."""
    temperature: FinitePositive = 0.1
    """Temperature of the targets in segments of the course, about 1.3 m each: moves whose worths differ by less are
    about as probable."""
    regret_weight: FiniteNonNegative = 1.0
    """Weight of the expected regret in the loss: how much less the student's moves are worth than the best ones, on
    average."""
    worst_regret: FinitePositive = 20.0
    """Greatest regret, in segments of progress: that of a fatal move, of options that are those of no move, and of all
    but the descent where the teacher sees no water."""
    auxiliary_weight: FiniteNonNegative = 0.3
    """Weight of the predictions of the privileged state and of the bird's-eye map; 0: they are not learnt."""
    teacher_steps: NonNegativeInt = 40_000
    """Steps over which the share of episodes that the teacher flies falls from 1 to 0."""
    start_share: Fraction = 0.5
    """Share of the environments whose flights begin anew every `start_steps`: a start shows less of the river than any
    other state, and a whole flight has only one."""
    start_steps: PositiveInt = 8
    """Most steps of such a flight; it also ends with its sequence."""
    noise: Fraction = 0.05
    """Share of random moves in flights, whose consequences the student learns to mend."""
    in_mirror: bool = True
    """Whether each sequence that was flown is learnt from a second time, as in a mirror."""
    mirrored: Fraction = 0.5
    """Share of the sequences drawn anew that are mirrored: left and right change places, memory begins empty."""
    corrupted_masks: Fraction = 0.2
    """Share of the sequences that are drawn anew whose masks are corrupted: rectangles of water and land that are not
    there. Has no effect without masks."""
    varied_looks: bool = True
    """Whether haze, exposure, water, season, camera angles and noise vary with each episode, and whenever it is drawn
    anew, and the sun with each river."""
    quality: Literal["fast", "full"] = "fast"
    """Quality of the frames of training; those that policies are evaluated on are `full`."""
    gate_rivers: NonNegativeInt = 300
    """Greatest number of rivers of each level, or of starts on a real river, that the teacher must fly to the end
    before anything is learnt."""

    @property
    def shape(self) -> NetworkShape:
        """Shape of the student's network."""
        eyes = Eyes((IMAGE_PX, IMAGE_PX, CHANNELS[self.observation]), self.filters, self.features)
        return NetworkShape(self.hidden, "relu", "kaiming", self.memory_size, eyes)
