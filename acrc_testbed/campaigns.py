"""Campaigns: carried out, opened, and compared."""

import warnings
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from acrc_testbed.errors import arguments_named
from acrc_testbed.shipped import file_of
from actors.installation.usage import wrong_value

if TYPE_CHECKING:
    import pyarrow

    from acrc_testbed.experiments.comparison import Comparison
    from acrc_testbed.experiments.store import Store


@dataclass(frozen=True)
class Campaign:
    """A campaign in its folder, finished or not."""

    folder: Path

    @arguments_named()
    def results(self) -> "pyarrow.Table":
        """Return a row for each run that has ended: strategy, seed, variant, and every metric."""
        import pyarrow

        from acrc_testbed.experiments import campaign

        return pyarrow.table(campaign.columns(self._kept()))

    @arguments_named()
    def compare(self, metric: str | None = None) -> "list[Comparison]":
        """Estimate how much every pair of strategies differs, with intervals; the declared pairs first.

        `metric`: only this one. Warns where a repeated run had another digest.
        """
        from acrc_testbed.experiments import comparison
        from acrc_testbed.experiments.judgement import judge

        if metric is not None and not comparison.is_metric(metric):
            raise wrong_value("metric", metric, comparison.CHOICE)
        return list(judge(self._kept(), metric).estimates)

    @arguments_named()
    def sentences(self) -> list[str]:
        """Say which runs failed, and what the declared comparisons come to: places decide, then time."""
        from acrc_testbed.experiments.judgement import judge

        return judge(self._kept()).sentences()

    def _kept(self) -> "Store":
        from acrc_testbed.experiments import store
        from acrc_testbed.experiments.store import differing

        kept = store.load(self.folder)
        for sentence in differing(kept):
            warnings.warn(sentence, stacklevel=3)
        return kept


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
    """Carry out a study, by its file or the name of a shipped one; a campaign that was begun goes on.

    Arguments mean what the options of `acrc campaign` mean. `out`: its folder; None: one in campaigns/.
    `overwrite`: the campaign in that folder does not go on but is removed, and begins again.
    """
    from acrc_testbed.experiments import campaign, store
    from acrc_testbed.experiments.campaign import CampaignOptions, carry_out
    from acrc_testbed.experiments.draws import StudyOptions, check, study_of
    from acrc_testbed.results.seal import seal
    from actors.robot.behaviour.code_permit import permit_of
    from actors.runtime.isolation.sandbox import choose_isolation
    from deploy.run import out_folder

    file = file_of("studies", study)
    asked = study_of(StudyOptions(file, seeds=seeds))
    if asked.isolated:
        choose_isolation(True)  # refused here, not run by run
    _, folders = check(asked, permit_of([Path(one) for one in modules], trust=trust), file)
    folder = Path(out or Path("campaigns", asked.name)).absolute()
    with out_folder.replacing(folder, "study.json") if overwrite else nullcontext():
        kept = store.create(folder, asked)
        try:
            carry_out(kept, CampaignOptions(jobs, check_every=check_every, modules=folders))
        finally:
            campaign.write(kept)
            seal(kept.folder)
    return Campaign(kept.folder)


@arguments_named()
def open_campaign(folder: str | PathLike[str]) -> Campaign:
    """Open the campaign in a folder. Raises AcrcError if there is none, or if it is not as it was left."""
    from acrc_testbed.experiments import store

    return Campaign(store.load(Path(folder)).folder.absolute())
