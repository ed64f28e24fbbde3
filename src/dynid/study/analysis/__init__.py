"""Analysis of a study: statistics, Sobol indices, local sensitivities, the worst sample."""

from dynid.study.analysis.design import Tornado, one_at_a_time, saltelli_design, tornado
from dynid.study.analysis.influence import (
    Indices,
    Influences,
    classes,
    correlations,
    from_design,
    from_samples,
    scatter,
)
from dynid.study.analysis.sample_statistics import statistics, worst
from dynid.study.analysis.table import StudyTable, failures

__all__ = [
    "Indices",
    "Influences",
    "StudyTable",
    "Tornado",
    "classes",
    "correlations",
    "failures",
    "from_design",
    "from_samples",
    "one_at_a_time",
    "saltelli_design",
    "scatter",
    "statistics",
    "tornado",
    "worst",
]
