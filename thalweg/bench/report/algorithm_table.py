"""Which algorithms are compared, and of which kind are they? The paper's table of domains and methods, made of the
registry, so that an algorithm that is added there has its row."""

from thalweg.algos.constraint.multiplier import MultiplierConfig
from thalweg.algos.offpolicy.config import OffPolicyConfig
from thalweg.algos.onpolicy.config import OnPolicyConfig
from thalweg.algos.planning.config import PlanningConfig
from thalweg.algos.registry import ALGORITHMS, Entry
from thalweg.bench.report.extra_tables import Sheet
from thalweg.bench.results.inference import Estimate
from thalweg.bench.results.results import Results
from thalweg.bench.suite.suites import arms_of

DOMAINS = {OnPolicyConfig: "on-policy", OffPolicyConfig: "off-policy", PlanningConfig: "model-based"}
"""By what configs of each have in common."""


def domain(entry: Entry) -> str:
    """Where an algorithm takes what it learns from."""
    return next((name for kind, name in DOMAINS.items() if issubclass(entry.config, kind)), "unknown")


def keeps_by(entry: Entry) -> str:
    """How an algorithm keeps the limit, as far as its settings tell."""
    if not hasattr(entry.config, "cost_limit"):
        return "not at all"
    return "a multiplier" if issubclass(entry.config, MultiplierConfig) else "a way of its own"


def methods(results: Results) -> Sheet:
    """A row for each arm of the suite; one whose algorithm is gone says so."""
    rows: list[list[str | float | Estimate]] = []
    for arm in arms_of(results.suite):
        entry = ALGORITHMS.get(arm["algorithm"])
        rest = ["unknown"] * 3 if entry is None else [domain(entry), keeps_by(entry), entry.about]
        rows.append([arm["name"], *rest])
    return Sheet(("policy", "domain", "limit kept by", "method"), rows)
