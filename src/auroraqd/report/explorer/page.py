"""The page of the explorer as HTML: figures and library of Bokeh, and what is ours, `page.html`, `page.css` and `page.js`."""

import secrets
from collections.abc import Sequence
from importlib.resources import files
from typing import Any

import numpy as np

from auroraqd.report.explorer.runs import Source, check_any, content

_HERE = files(__name__.rpartition(".")[0])


def written(sources: Sequence[Source], most: int, *, nonce: str | None = None, live: str = "") -> str:
    """HTML of a page to look at the skills of runs.

    Args:
        sources: of the runs, as `check_skills` wants them.
        most: skills in the page.
        nonce: of its scripts: only they run. By default a new one.
        live: names the checkpoint that is shown, if a server says which ones there are; see `auroraqd.report.explorer.serving`.
    """
    from bokeh.embed import file_html
    from bokeh.resources import Resources

    from auroraqd.report.explorer.compared import table
    from auroraqd.report.explorer.figures import document

    runs = [content(source, max(most // len(sources), 1), 1 / len(sources), live=bool(live)) for source in sources]
    _colour(runs)
    names, nonce = [source.name for source in sources], nonce or secrets.token_urlsafe()
    rows = table(names, [source.repertoire for source in sources]) if len(runs) > 1 else []
    shown, maps = document(runs)
    texts = {name: (_HERE / f"page.{name}").read_text() for name in ("css", "js")}
    return file_html(
        shown,
        resources=Resources(mode="inline"),
        title=" and ".join(names),
        template=(_HERE / "page.html").read_text(),
        template_variables={
            **texts,
            "maps": maps,
            "compared": rows,
            "nonce": nonce,
            "policy": policy(nonce, connect="'self'" if live else "'none'"),
            "live": live,
        },
    )


def check_bokeh() -> None:
    """Raise ValueError unless Bokeh is installed."""
    try:
        import bokeh.embed  # noqa: F401
    except ImportError:
        raise ValueError('Bokeh is not installed: pip install "auroraqd[explore]"') from None


def policy(nonce: str, *, connect: str = "'none'") -> str:
    """What a page may do, as browsers take it (Content-Security-Policy): run its own scripts, and fetch nothing.

    Bokeh compiles functions, those of WebGL for instance, which "unsafe-eval" permits to scripts that may run, and makes
    styles.

    Args:
        nonce: of the scripts; "" for a page that has none.
        connect: what scripts may ask.
    """
    scripts = f"'nonce-{nonce}' 'unsafe-eval'" if nonce else "'none'"
    return (
        f"default-src 'none'; script-src {scripts}; style-src 'unsafe-inline'; img-src data: blob:; connect-src {connect}; "
        "base-uri 'none'; form-action 'none'"
    )


def _colour(runs: list[dict[str, Any]]) -> None:
    """Give skills their colours, by their places in all of the runs together."""
    from auroraqd.report.explorer.colours import place_colours

    everywhere = np.concatenate([run.pop("places") for run in runs])
    colours = place_colours(everywhere)
    ends = np.cumsum([len(run["rows"]) for run in runs])
    for run, own in zip(runs, np.split(colours, ends[:-1]), strict=True):
        run["place"] = own
        for moment in run["moments"]:  # a place in the ground truth has one colour at all times
            box = everywhere if run["placed"] == "ground truth" else None
            moment["colours"] = place_colours(moment.pop("colours_by"), box)


def check_skills(sources: Sequence[Source]) -> None:
    """Raise ValueError unless each run has a skill, and several have a ground truth, of one shape."""
    for source in sources:
        check_any(source.name, len(source.repertoire))
    if len(sources) < 2:
        return
    truths = [source.repertoire.ground_truth for source in sources]
    for source, truth in zip(sources, truths, strict=True):
        if truth is None:
            raise ValueError(f"run: several are compared by their ground truth, and {source.name} has none")
        if truth.shape[1:] != truths[0].shape[1:]:  # pyright: ignore[reportOptionalMemberAccess]
            raise ValueError(
                f"run: several are compared by their ground truth, of one shape, and {source.name} has {truth.shape[1:]}"
            )
