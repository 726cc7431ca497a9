"""Run, open and compare campaigns."""

import warnings
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from acrc_testbed.argument_names import arguments_named
from acrc_testbed.shipped import file_of

if TYPE_CHECKING:
    import pyarrow

    from acrc_testbed.experiments.comparison import Comparison
    from acrc_testbed.experiments.store import Store


@dataclass(frozen=True)
class Campaign:
    """A campaign's folder; the campaign may be incomplete."""

    folder: Path

    @arguments_named()
    def results(self) -> "pyarrow.Table":
        """Return a row for each completed trial: strategy, seed, variant and every metric."""
        import pyarrow

        from acrc_testbed.experiments import campaign

        return pyarrow.table(campaign.columns(self._store()))

    @arguments_named()
    def compare(self, metric: str | None = None) -> "list[Comparison]":
        """Estimate the difference of each pair of strategies, with intervals; declared pairs come first.

        `metric`: estimate this metric only. Warns if a repeated run has a different digest.
        """
        from acrc_testbed.experiments.evaluation import evaluate
        from acrc_testbed.experiments.metrics import chosen_metric

        store = self._store()
        chosen = chosen_metric("metric", metric, store.study.metrics())
        return list(evaluate(store, chosen).estimates)

    @arguments_named()
    def sentences(self) -> list[str]:
        """Return failures and results of the declared comparisons as sentences."""
        from acrc_testbed.experiments.evaluation import evaluate

        return evaluate(self._store()).sentences()

    def _store(self) -> "Store":
        from acrc_testbed.experiments.store import difference_sentences, load_store

        store = load_store(self.folder)
        for sentence in difference_sentences(store):
            warnings.warn(sentence, stacklevel=3)
        return store


@arguments_named()
def campaign(
    study: str | PathLike[str],
    out: str | PathLike[str] | None = None,
    *,
    seeds: int | None = None,
    jobs: int = 0,
    check_every: int = 20,
    modules: Sequence[str | PathLike[str]] = (),
    trust: bool = False,
    overwrite: bool = False,
) -> Campaign:
    """Run a study, given as a file or the name of a shipped one; resume its campaign if it exists.

    Arguments have the meaning of the options of `acrc campaign`. `out`: folder of the campaign; None:
    campaigns/NAME. `overwrite`: delete an existing campaign instead of resuming it.
    """
    from acrc_testbed.experiments import campaign
    from acrc_testbed.experiments.campaign import CampaignOptions, run_campaign
    from acrc_testbed.experiments.store import create_store
    from acrc_testbed.experiments.trial_settings import StudyOptions, check_study, make_study
    from acrc_testbed.results.seal import seal
    from actors.robot.behaviour.code_permit import permit_of
    from actors.runtime.isolation.sandbox import choose_isolation
    from deploy.run import out_folder

    file = file_of("studies", study)
    permit = permit_of([Path(one) for one in modules], trust=trust)
    prepared = make_study(StudyOptions(file, seeds=seeds))
    if prepared.isolated:
        choose_isolation(True)  # refuse before the first trial
    _, folders = check_study(prepared, permit, file)
    folder = Path(out or Path("campaigns", prepared.name)).absolute()
    with out_folder.replace_folder(folder, "study.json") if overwrite else nullcontext():
        store = create_store(folder, prepared)
        try:
            run_campaign(store, CampaignOptions(jobs, check_every=check_every, folders=folders))
        finally:
            campaign.write_tables(store)
            seal(store.folder)
    return Campaign(store.folder)


@arguments_named()
def open_campaign(folder: str | PathLike[str]) -> Campaign:
    """Open the campaign in a folder. Raises AcrcError if there is none or its files were changed."""
    from acrc_testbed.experiments.store import load_store

    return Campaign(load_store(Path(folder)).folder.absolute())
