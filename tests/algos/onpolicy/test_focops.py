"""FOCOPS: what its loss draws at, and whether its page names settings that exist."""

import re
from pathlib import Path

import pytest
import torch

from thalweg.algos.common.settings import config_from
from thalweg.algos.onpolicy.focops import FOCOPSConfig, policy_loss
from thalweg.algos.registry import ALGORITHMS

DOCS = Path(__file__).parents[3] / "docs" / "algorithms"


def gradient(config: FOCOPSConfig) -> torch.Tensor:
    """[2, 3] of the loss with respect to logits: the first state's policy is near the old one, the second's far."""
    logits = torch.tensor([[0.05, 0.0, 0.0], [1.0, 0.0, 0.0]], dtype=torch.float64, requires_grad=True)
    old, new = torch.zeros(2, 3, dtype=torch.float64).log_softmax(-1), logits.log_softmax(-1)
    kl, entropy = (new.exp() * (new - old)).sum(-1), -(new.exp() * new).sum(-1)
    assert (kl <= config.trust_radius).tolist() == [True, False]
    policy_loss(config, new[:, 0], old[:, 0], kl, torch.ones(2, dtype=torch.float64), entropy).backward()
    assert logits.grad is not None
    return logits.grad


def test_outside_the_trust_region_only_the_entropy_draws():
    without, little, more = (gradient(FOCOPSConfig(entropy=weight)) for weight in (0.0, 0.01, 0.02))
    assert without[0].abs().sum() > 0 and without[1].abs().sum() == 0
    # c H / 2 of the far state: dH/dlogit_k = -p_k (log p_k + H)
    p = torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64).softmax(-1)
    entropy = -(p * p.log()).sum()
    assert little[1].numpy() == pytest.approx((0.01 / 2 * p * (p.log() + entropy)).numpy(), abs=1e-12)
    assert more[1].numpy() == pytest.approx(2 * little[1].numpy())


@pytest.mark.parametrize("name", ALGORITHMS)
def test_the_settings_that_a_page_sets_exist_and_differ_from_the_defaults(name):
    text, kind = (DOCS / f"{name.lower()}.md").read_text(), ALGORITHMS[name].config
    text = text.replace("\\\n", " ")
    given = {}
    for line in re.findall(rf"--algorithm {name}.* --set (.*)", text):
        given |= {key: float(value) for key, value in re.findall(r"(\w+)=([\d.]+)", line)}
    kinds = {key: type(getattr(kind(), key)) for key in given}
    config = config_from(kind, {key: kinds[key](value) for key, value in given.items()})
    assert config is not None and all(getattr(config, key) != getattr(kind(), key) for key in given)


def test_the_page_names_every_setting_of_the_source_with_its_value_here():
    rows = re.findall(r"^\| (`.*?) \| (.*?) \| (.*?) \| .*\|$", (DOCS / "focops.md").read_text(), re.M)
    table = {key: (source, here) for names, source, here in rows for key in re.findall(r"`(\w+)`", names)}
    numbers = {key: float(here) for key, (_, here) in table.items() if re.fullmatch(r"[\d.e-]+", here)}
    assert {"temperature", "multiplier_rate", "learning_rate", "minibatch"} <= set(numbers)
    assert numbers == {key: getattr(FOCOPSConfig(), key) for key in numbers}
