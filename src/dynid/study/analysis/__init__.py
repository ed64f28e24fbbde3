"""Analysis of a study: statistics, sources of variance, local sensitivities, the worst sample."""

from dynid.study.analysis.correlation import correlations, scatter
from dynid.study.analysis.design import one_at_a_time, saltelli_design
from dynid.study.analysis.failures import failures
from dynid.study.analysis.influence import Indices, classes, from_design, from_samples
from dynid.study.analysis.moments import statistics
from dynid.study.analysis.ranking import Influences
from dynid.study.analysis.table import StudyTable
from dynid.study.analysis.tornado import Tornado, tornado
from dynid.study.analysis.worst import worst

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
