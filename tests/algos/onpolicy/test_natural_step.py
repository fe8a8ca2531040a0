"""Natural steps of a small policy, against a Fisher matrix that is written out."""

import gymnasium as gym
import pytest
import torch
from torch.nn.utils import parameters_to_vector

from tests.algos.rollouts import rollout_of
from thalweg.algos.interface import Rollout, Task
from thalweg.algos.maths import losses
from thalweg.algos.maths.trust_region import natural_step
from thalweg.algos.onpolicy.agent import Agent, reward_signal
from thalweg.algos.onpolicy.config import NaturalConfig
from thalweg.algos.onpolicy.kl_monitor import KLMonitor
from thalweg.algos.onpolicy.natural_step import NaturalStep

N, T, D = 4, 32, 5
SPACES = {"MultiDiscrete": gym.spaces.MultiDiscrete([3, 2]), "Box": gym.spaces.Box(-1.0, 1.0, (2,))}


def flown(agent: Agent, **changes: torch.Tensor) -> Rollout:
    """What the agent did on its way through random observations, rewarded at random."""
    generator = torch.Generator().manual_seed(0)
    obs = torch.randn(T + 1, N, D, generator=generator)
    actions = torch.stack([agent.act(obs[t], torch.zeros(N, dtype=torch.bool)) for t in range(T)])
    return rollout_of(obs, actions=actions, **({"rewards": torch.rand(T, N, generator=generator)} | changes))


def place(space: gym.Space, **settings) -> tuple[Agent, KLMonitor, NaturalStep, torch.Tensor]:
    """An agent that has seen a rollout, in double precision, and the advantages of it."""
    usual = {"steps_per_update": 128, "hidden": (3,), "damping": 0.0, "conjugate_iterations": 200}
    config = NaturalConfig(**(usual | settings))
    agent = Agent("any", 1, config, Task(D, space, N, 0, {}))
    rollout = flown(agent)
    samples = agent.samples(rollout, [reward_signal(config, rollout)])
    agent.policy.actor.double()
    with torch.no_grad():  # away from the uniform start, where many things are equal by chance
        for parameter in agent.policy.actor.parameters():
            parameter += 0.3 * torch.randn(parameter.shape, dtype=torch.float64, generator=agent.generator)
    samples = type(samples)(**{**vars(samples), "inputs": samples.inputs.double()})  # pyright: ignore
    monitor = KLMonitor(agent, samples)
    return agent, monitor, NaturalStep(agent, samples, monitor, config), samples.advantages[0].double()


def fisher(agent: Agent, monitor: KLMonitor, natural: NaturalStep) -> torch.Tensor:
    """The mean over states and actions of ∇log π ∇log π' [P, P]; for the Gaussian, over many draws of the action."""
    actor, inputs = agent.policy.actor, natural._samples.inputs
    parameters = list(actor.parameters())
    total = torch.zeros(sum(p.numel() for p in parameters), dtype=torch.float64)
    matrix = torch.outer(total, total)
    jacobians = []
    outputs = actor(inputs, twice_differentiable=True)
    for output in outputs.flatten():
        rows = torch.autograd.grad(output, parameters, retain_graph=True, allow_unused=True)
        rows = [torch.zeros_like(p) if row is None else row for p, row in zip(parameters, rows, strict=True)]
        jacobians.append(parameters_to_vector(rows))
    jacobian = torch.stack(jacobians).view(*outputs.shape, -1)
    for state, output in enumerate(outputs.detach()):
        matrix += jacobian[state].T @ curvature(agent, output) @ jacobian[state]
    return matrix / len(outputs)


def curvature(agent: Agent, output: torch.Tensor) -> torch.Tensor:
    """The Fisher matrix of one state's logits or means and deviations, in closed form."""
    sizes = agent.policy.actions.sizes
    if sizes:
        blocks = [part.softmax(0) for part in output.split(list(sizes))]
        return torch.block_diag(*[p.diag() - torch.outer(p, p) for p in blocks])
    mean, log_std = output.chunk(2)
    return torch.diag(torch.cat([(-2 * log_std).exp(), torch.full_like(mean, 2.0)]))


@pytest.mark.parametrize("space", SPACES.values(), ids=list(SPACES))
def test_the_step_solves_the_fisher_matrix(space: gym.Space):
    agent, monitor, natural, advantages = place(space)
    gradient = natural.gradient(advantages)
    along = natural.solve(gradient)
    assert fisher(agent, monitor, natural) @ along == pytest.approx(gradient, abs=2e-5 * float(gradient.norm()))


def test_a_kl_per_dimension_is_that_many_times_flatter():
    whole, mean = (place(SPACES["MultiDiscrete"], kl_per_dimension=flag) for flag in (False, True))
    gradient = whole[2].gradient(whole[3])
    assert mean[2].solve(gradient) == pytest.approx(2.0 * whole[2].solve(gradient), rel=1e-5)


def test_the_gradient_is_that_of_the_surrogate():
    agent, monitor, natural, advantages = place(SPACES["MultiDiscrete"])
    gradient, flat = natural.gradient(advantages), agent.policy.actor.stack.flat
    samples = natural._samples
    for index in (0, 7):
        values = []
        for change in (1e-5, -1e-5):
            with torch.no_grad():
                flat[index] += change
                log_prob = agent.policy.distribution_of(samples.inputs).log_prob(samples.actions)
                values.append(losses.surrogate(log_prob, monitor.old_log_prob, advantages).item())
                flat[index] -= change
        assert gradient[index].item() == pytest.approx((values[0] - values[1]) / 2e-5, abs=1e-8)


def test_the_search_takes_the_first_step_that_is_close_enough_and_accepted():
    agent, monitor, natural, advantages = place(SPACES["MultiDiscrete"])
    step = natural.solve(natural.gradient(advantages))
    step = step * (0.15 / float(step.norm()))
    asked: list[float] = []

    def third(log_prob: torch.Tensor, imitation: float) -> bool:
        asked.append(float((log_prob - monitor.old_log_prob).abs().max()))
        return len(asked) == 3

    before = parameters_to_vector(agent.policy.actor.parameters()).clone()
    refused = natural.search(step, third)
    assert len(asked) == 3 and asked[0] > asked[1] > asked[2]
    moved = parameters_to_vector(agent.policy.actor.parameters()) - before
    assert moved.detach() == pytest.approx(0.8**refused * step, abs=1e-12)
    monitor.measure()
    assert monitor.kl <= 0.02


def test_a_step_that_nothing_accepts_leaves_the_policy():
    agent, _, natural, advantages = place(SPACES["MultiDiscrete"])
    before = parameters_to_vector(agent.policy.actor.parameters()).clone()
    assert natural.search(natural.gradient(advantages), lambda log_prob, imitation: False) == 15
    assert torch.equal(parameters_to_vector(agent.policy.actor.parameters()), before)


def test_critics_alone_learn_from_their_passes():
    config = NaturalConfig(steps_per_update=128, passes=30, minibatch=32, critic_learning_rate=1e-2)
    agent = Agent("any", 1, config, Task(D, SPACES["Box"], N, 0, {}))
    rollout = flown(agent)
    samples = agent.samples(rollout, [reward_signal(config, rollout)])
    actor = [parameter.clone() for parameter in agent.policy.actor.parameters()]
    first = losses.squared_error(agent.critics(samples.inputs), samples.targets).item()
    with agent.critics_learning(samples, config.passes):
        pass
    assert losses.squared_error(agent.critics(samples.inputs), samples.targets).item() < 0.5 * first
    assert all(torch.equal(a, b) for a, b in zip(actor, agent.policy.actor.parameters(), strict=True))


def test_steps_that_only_reset_do_not_shorten_the_step():
    config = NaturalConfig(steps_per_update=128)
    agent = Agent("any", 1, config, Task(D, SPACES["MultiDiscrete"], N, 0, {}))
    valid = torch.ones(T, N, dtype=torch.bool)
    valid[::2] = False
    rollout = flown(agent, valid=valid)
    samples = agent.samples(rollout, [reward_signal(config, rollout)])
    assert len(samples.actions) == T * N // 2
    assert NaturalStep(agent, samples, KLMonitor(agent, samples), config).radius == config.trust_radius


@pytest.mark.parametrize(
    ("progress", "settles", "share"), [(0.0, True, 1.0), (0.75, True, 1.0), (0.9, True, 0.4), (0.9, False, 1.0)]
)
def test_the_step_shrinks_to_zero_over_the_last_quarter_of_a_run(progress: float, settles: bool, share: float):
    agent, monitor, natural, _ = place(SPACES["MultiDiscrete"])
    config = NaturalConfig(radius_settles=settles)
    later = NaturalStep(agent, natural._samples, monitor, config, progress)
    assert later.radius == pytest.approx(config.trust_radius * share)


@pytest.mark.parametrize(("steps", "share"), [(128, 1.0), (100, 1.0), (512, 0.25)])
def test_from_a_rollout_cut_short_the_step_is_shorter(steps: int, share: float):
    _, _, natural, _ = place(SPACES["MultiDiscrete"], steps_per_update=steps)
    assert natural.radius == pytest.approx(0.02 * share)


@pytest.mark.parametrize(("per_dimension", "refused"), [(False, True), (True, False)])
def test_the_search_bounds_the_kl_per_dimension_if_told(per_dimension: bool, refused: bool):
    _, _, natural, advantages = place(SPACES["MultiDiscrete"], kl_per_dimension=per_dimension, trust_radius=1e-5)
    gradient = natural.gradient(advantages)
    along, share = natural.solve(gradient), 0.5 if per_dimension else 1.0
    step = natural_step(float(gradient.dot(along)), 1.5e-5 * share) * along  # a KL of 1.5e-5, of two dimensions
    assert (natural.search(step, lambda log_prob, imitation: True) > 0) == refused
