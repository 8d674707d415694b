"""Figures, made from stored runs only."""

from auroraqd.report.experiment import write_report
from auroraqd.report.run import history_figure, repertoire_figure, write_figures

__all__ = ["history_figure", "repertoire_figure", "write_figures", "write_report"]
