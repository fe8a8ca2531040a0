"""Checks of a suite when it is constructed: it names only what exists, nothing twice, and what goes together."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.constraint.cost_limits import check_cost_episodes
from thalweg.algos.registry import algorithm_named, algorithm_names
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.baselines import BASELINES
from thalweg.bench.evaluate.rivers import check_files, refuse_unknown_levels
from thalweg.bench.evaluate.shielded import check_masks
from thalweg.bench.packaged import PACKAGED
from thalweg.bench.suite.arms import Arm, refuse_repeated
from thalweg.bench.suite.flown import SavedPolicy
from thalweg.bench.suite.names import refuse_long_names
from thalweg.core.config import refuse_unknown
from thalweg.core.plugins.record import PluginError
from thalweg.encoder import encoder_names, encoder_size
from thalweg.env.tasks import task_names
from thalweg.train.encoder_of_run import check_size_fits
from thalweg.train.errors import TrainingError
from thalweg.train.observations import FRAMES, IMAGES, PRIVILEGED, action_of, check_policy_fits
from thalweg.train.river import RiverTraining, load_compatible_encoder
from thalweg.train.run import check_warmup, sees_images

if TYPE_CHECKING:
    from thalweg.bench.suite.config import Suite


def check_suite(suite: "Suite") -> None:
    """Raise `ValueError` for what does not exist, does not go together, or is named twice."""
    try:
        check_files(suite.files)
        _check_known(suite)
        _check_rivers(suite)
        _check_repeated(suite)
        _check_actions(suite)
        _check_views(suite)
        _check_saved(suite)
        _check_names(suite)
    except ValueError as error:
        raise ValueError(f"suite {suite.name}: {error}") from error
    if not suite.runs() or not suite.test_levels:
        raise ValueError(f"suite {suite.name} has nothing to do")
    for arm in suite.arms:
        for index, each in enumerate((*arm.before, arm)):
            try:
                config = algorithm_named(each.algorithm).configure(dict(each.settings), each.preset, suite.num_envs)
                check_cost_episodes(config, suite.num_envs)
                if index or arm.begin_with is not None:  # begins with the policy of the stage before, or another
                    check_warmup(config, each.steps, suite.num_envs)
                _check_sight(suite, arm, sees_images(config))
            except (AlgorithmError, PluginError, TrainingError) as error:
                stage = f", stage {index + 1}" if arm.before else ""
                raise ValueError(f"suite {suite.name}, {arm.label}{stage}: {error}") from error
        _check_begun(suite, arm)


def _check_sight(suite: "Suite", arm: Arm, has_convolutions: bool) -> None:
    """Raise `TrainingError` unless what an arm's policies see goes with whether they have convolutions."""
    seen = suite.seen_by(arm)
    if has_convolutions and seen not in IMAGES:
        raise TrainingError(f"policy=cnn sees images: set observation to {' or '.join(IMAGES)}, not {seen}")
    if seen in IMAGES and not has_convolutions:
        raise TrainingError(f"the observation {seen} is for policies with convolutions: set policy=cnn")
    if arm.begin_with is not None and seen != (sees := arm.begin_with.observation):
        how = f"set policy=cnn and observation to {sees}" if sees in IMAGES else f"set observation to {sees}"
        raise TrainingError(
            f"the policy {arm.begin_with.given} sees {sees}, not {seen}: leave begin_with out, or {how}"
        )


def _check_known(suite: "Suite") -> None:
    """Raise `ValueError` for an algorithm, a level or a baseline that does not exist."""
    stages = [stage for arm in suite.arms for stage in arm.before]
    refuse_unknown_levels(suite.grounds, suite.reaches)
    for what, names, known in (
        ("algorithm", [each.algorithm for each in (*suite.arms, *stages)], algorithm_names()),
        ("baseline", suite.baselines, BASELINES),
        ("task", [suite.task], task_names()),
        ("encoder", {suite.encoder, *(suite.coded_by(arm) for arm in suite.arms)}, encoder_names()),
    ):
        refuse_unknown(what, names, known, ValueError)


def _check_rivers(suite: "Suite") -> None:
    """Raise `ValueError` for a file that is not used, a real river with two files, for trainings and flights that
    are for levels alone, and for rivers that nothing is trained on."""
    for condition in suite.conditions:
        for name in condition.files:
            if name in suite.files and condition.river(name) != suite.reaches[name]:
                raise ValueError(f"river {name}: condition {condition.name} has another file, or other options")
    used = {*suite.grounds, *(name for condition in suite.conditions for name in condition.rivers)}
    if unused := [name for name in suite.files if name not in used]:
        raise ValueError(f"{unused[0]!r} of files is neither trained on nor flown on: leave it out")
    real = [name for name in suite.test_levels if name in suite.reaches]
    unseen = [each.name for each in suite.conditions if each.unseen and not each.levels]
    if real and unseen:
        raise ValueError(
            f"condition {unseen[0]}: {real[0]} is a real river, whose seeds change plants and hills, not its"
            f" course: give the condition levels of its own, such as {{name: {unseen[0]}, unseen: true, levels:"
            " [Medium]}"
        )
    for arm in suite.arms:
        for stage in (*arm.before, arm):
            ground = suite.ground(suite.level_of(stage))
            RiverTraining(ground, suite.num_envs, suite.seeds_of(arm, stage), suite.training_rules)


def _check_actions(suite: "Suite") -> None:
    """Raise `ValueError` for rules that do not go together, and for discrete actions where they are continuous."""
    if suite.training_rules.action == "multidiscrete":
        return
    if suite.packaged:
        raise ValueError("the packaged policy has no continuous actions, which the flights take: set packaged: false")
    for arm in suite.arms:
        if arm.begin_with is not None and action_of(arm.begin_with.policy) != suite.training_rules.action:
            raise ValueError(
                f"arm {arm.label}: the policy {arm.begin_with.given} has no continuous actions, which the flights"
                " take: leave begin_with out"
            )
    shields = [condition.name for condition in suite.conditions if condition.shield]
    if shields:
        raise ValueError(f"condition {shields[0]}: the shield judges no continuous actions, which the flights take")


def _check_views(suite: "Suite") -> None:
    """Raise `ValueError` for settings of frames where no policy is trained on any, since reports would tell of
    them, and for a camera whose frames do not fit an encoder."""
    of_frames = [name for name in suite.views.as_data() if name != "action"]
    if of_frames and suite.arms and {suite.seen_by(arm) for arm in suite.arms} == {PRIVILEGED}:
        raise ValueError(
            f"policies see the privileged observation, for which nothing is drawn: leave {' and '.join(of_frames)}"
            " of the views out"
        )
    for arm in suite.arms:
        if suite.seen_by(arm) == FRAMES:
            encoder = suite.coded_by(arm)
            try:
                check_size_fits(suite.views.camera, encoder_size(encoder), encoder)
            except TrainingError as error:
                raise ValueError(f"{arm.label}: {error}") from error


def _check_begun(suite: "Suite", arm: Arm) -> None:
    """Raise `ValueError` for a policy to begin with that does not fit the training of its arm.

    The one that comes with the package is compared by what it sees alone.
    """
    rules, begun, seen = suite.training_rules, arm.begin_with, suite.seen_by(arm)
    if begun is None or begun.is_packaged:
        return
    encoder = load_compatible_encoder(suite.coded_by(arm)) if seen == FRAMES else None
    try:
        check_policy_fits(begun.policy, encoder, offered=seen, task=rules.task, action=rules.action)
    except TrainingError as error:
        raise ValueError(f"suite {suite.name}, arm {arm.label}: {begun.given}: {error}") from error


def _check_saved(suite: "Suite") -> None:
    """Raise `ValueError` for a policy that was trained before and does not fit the flights."""
    rules, shielded = suite.rules, any(condition.shield for condition in suite.conditions)
    for file in (file for saved in suite.policies if isinstance(saved, SavedPolicy) for file in saved.policy):
        encoder = None if file.encoder is None else load_compatible_encoder(file.encoder)
        try:
            check_policy_fits(file.policy, encoder, task=rules.task, action=rules.action, dynamics=rules.dynamics)
            if shielded and file.observation != PRIVILEGED:
                check_masks(file.policy, encoder)
        except (TrainingError, ResultsError) as error:
            raise ValueError(f"{file.given}: {error}") from error


def _check_names(suite: "Suite") -> None:
    """Raise `ValueError` for names that are too long for the files of the results."""
    flown = [(run, [trial.level for trial in suite.trials(run)]) for run in suite.runs()]
    refuse_long_names(flown, [condition.name for condition in suite.conditions])


def _check_repeated(suite: "Suite") -> None:
    """Raise `ValueError` for anything that is named twice: its results would count twice.

    Labels and conditions are names of folders, which macOS and Windows do not tell apart by capitals.
    """
    labels = [*(each.label for each in (*suite.arms, *suite.policies)), *suite.baselines, PACKAGED]
    if repeated := _same_folder(labels):
        raise ValueError(f"{repeated}; give one of them a name of its own")
    refuse_repeated("level", "test_levels", suite.test_levels)
    if repeated := _same_folder(suite.test_levels):
        raise ValueError(f"test_levels: {repeated}")
    names = [condition.name for condition in suite.conditions]
    for name in names:
        if not name:
            raise ValueError("a condition is called ''; letters, digits, - and . will do")
    if repeated := _same_folder(names):
        raise ValueError(f"condition {repeated}")


def _same_folder(names: Sequence[str]) -> str:
    """Return what is wrong with the first name that stands twice, capitals aside; empty if none does."""
    seen: dict[str, str] = {}
    for name in names:
        if (before := seen.setdefault(name.casefold(), name)) != name:
            return f"{before} and {name} differ in capitals alone"
        if names.count(name) > 1:
            return f"{name} is named twice"
    return ""
