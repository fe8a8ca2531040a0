"""The table of the suite's algorithms, and that of its runs."""

from thalweg.algos.constraint.multiplier import MultiplierConfig
from thalweg.algos.offpolicy.config import OffPolicyConfig
from thalweg.algos.onpolicy.config import OnPolicyConfig
from thalweg.algos.planning.config import PlanningConfig
from thalweg.algos.registry import Entry, installed_algorithm
from thalweg.bench.report.policies import CRITICS_SEE
from thalweg.bench.report.table import Cell, Table, frame, table_from_cells
from thalweg.bench.results.results import RUN_COLUMNS, Results
from thalweg.bench.suite.record import arms_of
from thalweg.train.observations import FRAMES

DOMAINS = {OnPolicyConfig: "on-policy", OffPolicyConfig: "off-policy", PlanningConfig: "model-based"}
"""The paper's domains, by the base class of their algorithms' configs."""


def domain(entry: Entry) -> str:
    """Return the paper's domain of an algorithm."""
    return next((name for base, name in DOMAINS.items() if issubclass(entry.config, base)), "unknown")


def constraint_method(entry: Entry) -> str:
    """Return in words how an algorithm enforces the cost limit, as far as its config shows."""
    if not hasattr(entry.config, "cost_limit"):
        return "not at all"
    return "a multiplier" if issubclass(entry.config, MultiplierConfig) else "a way of its own"


def algorithm_table(results: Results) -> Table:
    """Return the domain and the method of each arm of the suite; `unknown` where its algorithm no longer exists.

    What the policies see is a column where it is not frames for all of them, and so are version and source of plug-ins
    where there are any.
    """
    columns, rows, seen = ["policy", "domain", "limit kept by", "method"], list[list[Cell]](), results.observations
    differs = any(observation != FRAMES for observation in seen.values())
    plugins = {arm["name"]: results.made_by(arm["name"]) for arm in arms_of(results.suite)}
    columns += ["observation"] * differs + [CRITICS_SEE] + ["plug-in"] * any(plugins.values())
    for arm in arms_of(results.suite):
        entry = installed_algorithm(arm["algorithm"])
        rest = ["unknown"] * 3 if entry is None else [domain(entry), constraint_method(entry), entry.about]
        rows.append([arm["name"], *rest, *[seen[arm["name"]]] * differs, results.critics_see(arm["name"])])
        rows[-1] += [plugins[arm["name"]] or "none"] * any(plugins.values())
    return table_from_cells(columns, rows)


def runs_table(results: Results) -> Table:
    """Return the outcome of each run; the figures are the rows of `runs.csv`, errors included."""
    texts = []
    for row in results.runs:
        trained = [f"{row.steps:,}", f"{row.wall_s:,.0f}", f"{row.steps_per_s:,.0f}"]
        texts.append([row.run, row.kind, row.status, *(trained if row.kind == "train" else ["not trained"] * 3)])
    figures = [[getattr(row, name) for name in RUN_COLUMNS] for row in results.runs]
    columns = ("run", "kind", "status", "steps", "seconds", "steps a second")
    return Table(frame(columns, texts), frame(RUN_COLUMNS, figures))
