"""Figures, made from stored runs only, and videos of robots."""

from auroraqd.report.experiment import write_report
from auroraqd.report.robots import film
from auroraqd.report.run import history_figure, repertoire_figure, write_figures

__all__ = ["film", "history_figure", "repertoire_figure", "write_figures", "write_report"]
