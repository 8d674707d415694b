"""Figures, made from stored runs only, pages to explore them in a browser, and videos of robots."""

from auroraqd._caches import place_for_matplotlib

place_for_matplotlib()  # which the modules below import

from auroraqd.report.experiment import write_report  # noqa: E402
from auroraqd.report.explorer import explore  # noqa: E402
from auroraqd.report.paper import write_paper  # noqa: E402
from auroraqd.report.robots import film  # noqa: E402
from auroraqd.report.run import history_figure, repertoire_figure, write_figures  # noqa: E402

__all__ = ["explore", "film", "history_figure", "repertoire_figure", "write_figures", "write_paper", "write_report"]
