"""Checks of one's own tasks, archives, emitters and descriptors: whether they keep what those of auroraqd promise::

    from auroraqd.testing import check_archive

    def test_my_archive():
        check_archive(lambda: MyArchive(radius=0.1), sequential=True)

A promise that is broken is an AssertionError, which says in a sentence which one it is and what was seen.
"""

from __future__ import annotations

import copy
import itertools
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np

from auroraqd._checks import function, shown, whole
from auroraqd.archives.base import INVALID, NEW, REJECTED, REPLACED, Archive, Placement
from auroraqd.archives.unstructured import UnstructuredArchive
from auroraqd.descriptors.descriptor import Descriptor
from auroraqd.individuals import Columns
from auroraqd.observations import finite_rows, streams_of
from auroraqd.runs import _transformers
from auroraqd.tasks import evaluated, name_of
from auroraqd.tasks.noise import other_seeds

_GENES = 3
_SEEDS = range(1, 6)  # of batches
_CHECKED = ("genotype", "fitness", "observation", "descriptor", "id", "curiosity", "born", "parent")


class _Broken(Exception):
    """What was seen where a promise is not kept."""


def check_archive(make: Callable[[], Archive], *, sequential: bool = False) -> None:
    """Check an archive of one's own.

    Args:
        make: gives an empty one each time it is called. Descriptors added are in [0, 1], of two dimensions, or as many as its
            attribute `n_dimensions` says.
        sequential: whether a batch is placed as if each individual met an archive that holds the ones before it.

    Raises:
        AssertionError: it breaks a promise.

    Examples:
        >>> import auroraqd
        >>> auroraqd.testing.check_archive(lambda: auroraqd.GridArchive((20, 20), low=0, high=1), sequential=True)
    """
    checks = [*_OF_ARCHIVES, *([_batch_equals_one_by_one] if sequential else [])]
    _run(checks, _name(make), make)


def check_emitter(emitter: Any, *, n_genes: int = 3) -> None:
    """Check an emitter of one's own.

    Args:
        emitter: which is copied, and stays as it is.
        n_genes: of the genotypes that it is to make.

    Raises:
        AssertionError: it breaks a promise.

    Examples:
        >>> import auroraqd
        >>> auroraqd.testing.check_emitter(auroraqd.emitters.Goals(first=0))
    """
    _run(_OF_EMITTERS, lambda: type(emitter).__name__, emitter, n_genes)


def check_descriptor(transformer: Any, *, trusted: Sequence[str] = ()) -> None:
    """Check a transformer of one's own, as a descriptor.

    Args:
        transformer: which is copied, and stays as it is. It is fitted on 60 observations of shape (6, 2).
        trusted: full names of the types that it consists of, beyond scikit-learn's and its own, for loading it.

    Raises:
        AssertionError: it breaks a promise.

    Examples:
        >>> import auroraqd
        >>> from sklearn.decomposition import PCA
        >>> auroraqd.testing.check_descriptor(PCA(n_components=2))
    """
    _run(_OF_DESCRIPTORS, lambda: type(transformer).__name__, transformer, trusted)


def check_task(task: Callable[..., Any], *, n_genes: int | None = None) -> None:
    """Check a task of one's own, by some dozens of evaluations.

    Args:
        task: see `auroraqd.tasks`.
        n_genes: of its genotypes, if it does not say so itself.

    Raises:
        AssertionError: it breaks a promise.
        ValueError: it is not known how many genes it has.

    Examples:
        >>> import auroraqd
        >>> auroraqd.testing.check_task(auroraqd.tasks.Ballistic())
        >>> auroraqd.testing.check_task(lambda genotypes: genotypes[:, :2] ** 2, n_genes=3)
    """
    function("task", task)
    known = getattr(task, "n_genes", None) if n_genes is None else n_genes
    if known is None:
        raise ValueError("n_genes must be given for a task that does not say it, got None")
    _run(_OF_TASKS, lambda: name_of(task), task, whole("n_genes", known))


def _run(checks: Iterable[Callable[..., None]], name: Callable[[], str], *arguments: Any) -> None:
    for check in checks:
        promise = (check.__doc__ or "").rstrip(".")
        try:
            check(*arguments)
        except _Broken as broken:
            raise AssertionError(f"{name()} does not keep the promise that {promise}: {broken}") from None
        except Exception as error:
            seen = f"it raised {type(error).__name__}: {error}"
            raise AssertionError(f"{name()} does not keep the promise that {promise}: {seen}") from error


def _name(make: Callable[[], Any]) -> Callable[[], str]:
    def name() -> str:
        try:
            return type(make()).__name__
        except Exception:
            return "the archive"

    return name


def _see(kept: bool | np.bool_, seen: str) -> None:
    if not kept:
        raise _Broken(seen)


# Archives


def _individuals(archive: Archive, n: int, seed: int = 0) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    return {
        "genotype": rng.random((n, _GENES)),
        "fitness": rng.random(n),
        "observation": rng.random((n, 4)),
        "descriptor": rng.random((n, getattr(archive, "n_dimensions", 2))),
    }


def _filled(make: Callable[[], Archive], n: int = 100) -> Archive:
    archive = make()
    for seed in _SEEDS:
        archive.add(**_individuals(archive, n, seed))
        archive.credit(archive.id[::3], np.ones(len(archive.id[::3]), int))
    return archive


def _seen(archive: Archive) -> dict[str, np.ndarray]:
    return {name: column.copy() for name, column in archive.columns.items()}


def _differ(one: Mapping[str, np.ndarray], other: Mapping[str, np.ndarray]) -> str | None:
    """The first column that differs, or None."""
    for name in sorted(set(one) | set(other)):
        if name not in one or name not in other or not np.array_equal(one[name], other[name], equal_nan=True):
            return name
    return None


def _check_same(one: Archive, other: Archive, what: str) -> None:
    column = _differ(_seen(one), _seen(other))
    _see(column is None, f"column {column} differs {what}")
    _see(one.state == other.state, f"state differs {what}, {shown(one.state)} and {shown(other.state)}")


def _check_same_course(one: Archive, other: Archive, what: str) -> None:
    """Whether the same batches lead both to the same."""
    _check_same(one, other, what)
    for seed in (101, 102):
        batch = _individuals(one, 100, seed)
        _see(np.array_equal(one.add(**batch), other.add(**batch)), f"another batch is given other statuses {what}")
        _check_same(one, other, f"{what}, after another batch")
    for archive in (one, other):
        archive.redescribe(0.9 * archive.descriptor)
    _check_same(one, other, f"{what}, after all were added again")


def _begins_empty(make: Callable[[], Archive]) -> None:
    """each archive that is made is empty, and one does not share what it holds with another."""
    archive = make()
    _see(isinstance(archive, Archive), f"got {shown(archive)}, no Archive")
    _see(len(archive) == 0, f"it holds {len(archive)} individuals")
    archive.credit([3], [1])
    archive.redescribe(np.empty((0, getattr(archive, "n_dimensions", 2))))
    archive.add(**_individuals(archive, 50))
    _see(len(archive) > 0, "of 50 individuals that differ not one was stored in an empty archive")
    _see(len(make()) == 0, "a second one holds what was added to the first")


def _columns_belong_together(make: Callable[[], Archive]) -> None:
    """row i of all columns is one individual, as it was added."""
    archive = make()
    batch = _individuals(archive, 300)
    archive.add(**batch, ground_truth=np.arange(300.0)[:, None], born=np.arange(300))
    truth = archive.ground_truth
    _see(truth is not None and len(archive.columns["id"]) == len(archive), f"there are not {len(archive)} of each")
    rows = archive.born
    for name, values in {**batch, "ground_truth": np.arange(300.0)[:, None]}.items():
        _see(np.array_equal(archive.columns[name], values[rows]), f"{name} is of other individuals than born")


def _columns_cannot_be_written(make: Callable[[], Archive]) -> None:
    """columns are read-only."""
    archive = _filled(make)
    for name in _CHECKED:
        _see(not getattr(archive, name).flags.writeable, f"{name} can be written")


def _statuses_and_rows_add_up(make: Callable[[], Archive]) -> None:
    """statuses, rows and the ids removed tell what has become of a batch."""
    archive = make()
    for seed in _SEEDS:
        batch, before = _individuals(archive, 100, seed), set(archive.id.tolist())
        first = archive.state["next_id"]
        columns = Columns({**batch, "born": np.arange(100), "parent": np.full(100, -1)})
        status, row, removed, _ = archive.insert(columns, np.ones(100, bool))
        now, gone = set(archive.id.tolist()), set(removed.tolist())
        given = set(range(first, archive.state["next_id"]))
        _see(status.shape == row.shape == (100,), f"status has shape {status.shape} and row {row.shape}, for 100 individuals")
        wrong = set(np.unique(status).tolist()) - {REJECTED, NEW, REPLACED}
        _see(not wrong, f"status {shown(wrong)} was given to a valid individual")
        _see(
            len(given) == np.count_nonzero(status > 0),
            f"{len(given)} ids were given, and {np.count_nonzero(status > 0)} stored",
        )
        _see(not (row[status == REJECTED] >= 0).any(), "one that was rejected has a row")
        kept = row >= 0
        _see(
            np.array_equal(archive.genotype[row[kept]], batch["genotype"][kept]),
            "in the row that is told for an individual there is another",
        )
        _see(now | gone == before | given and not now & gone, "those that were there, and came, are not those that stay and go")
        _see(len(now & given) == np.count_nonzero(kept), "there are more rows than individuals of the batch that are stored")


def _ids_are_never_given_twice(make: Callable[[], Archive]) -> None:
    """an id is never given twice."""
    archive, known = make(), {}
    for seed in range(12):
        archive.add(**_individuals(archive, 60, seed))
        if seed % 3 == 2:
            archive.redescribe(0.9 * archive.descriptor)
        _see(len(np.unique(archive.id)) == len(archive), "two stored individuals have the same")
        for number, genotype in zip(archive.id.tolist(), archive.genotype.tolist(), strict=True):
            _see(known.setdefault(number, genotype) == genotype, f"id {number} was given to two individuals")
        found = archive.rows_of(archive.id)
        _see(np.array_equal(found, np.arange(len(archive))), "rows_of does not find an individual by its id")


def _invalid_ones_are_not_stored(make: Callable[[], Archive]) -> None:
    """individuals with a NaN or an infinity are invalid, and change nothing for the others."""
    for name in ("fitness", "observation", "descriptor"):
        archive, twin = make(), make()
        for seed in _SEEDS:
            batch, bad = _individuals(archive, 60, seed), np.arange(60) % 4 == 1
            batch[name][bad] = [np.nan, np.inf, -np.inf][seed % 3]
            status = archive.add(**batch)
            _see(np.array_equal(status == INVALID, bad), f"not those, and only those, of which the {name} is bad are invalid")
            twin.add(**{key: values[~bad] for key, values in batch.items()})
        _check_same(archive, twin, f"from an archive that was given those with a good {name} only")


def _the_same_leads_to_the_same(make: Callable[[], Archive]) -> None:
    """the same individuals lead to the same archive."""
    _check_same_course(_filled(make), _filled(make), "between two archives that were told the same")


def _batch_equals_one_by_one(make: Callable[[], Archive]) -> None:
    """a batch is placed as if each met an archive that holds the ones before it, being sequential."""
    together, apart = make(), make()
    batch = _individuals(together, 200)
    status = together.add(**batch)
    single = [apart.add(**{name: values[i : i + 1] for name, values in batch.items()})[0] for i in range(200)]
    wrong = np.flatnonzero(status != single)
    _see(not len(wrong), f"individual {wrong[:1]} was given status {status[wrong[:1]]} in a batch")
    _check_same(together, apart, "between a batch and one by one")


def _redescribing_keeps_individuals(make: Callable[[], Archive]) -> None:
    """redescribe gives new descriptors, and lets individuals go, but changes nothing else."""
    archive = _filled(make)
    before = {number: row for row, number in enumerate(archive.id.tolist())}
    held = _seen(archive)
    new = 0.5 * held["descriptor"]
    staying = archive.redescribe(new)
    _see(0 < len(archive) <= len(before), f"of {len(before)} individuals {len(archive)} are left")
    _see(staying == len(archive), f"it returned {staying}, and {len(archive)} stay")
    unknown = set(archive.id.tolist()) - set(before)
    _see(not unknown, f"individuals have new ids, {shown(unknown)}")
    rows = np.array([before[number] for number in archive.id.tolist()])
    _see(np.array_equal(archive.descriptor, new[rows]), "an individual has the descriptor of another")
    for name in set(_CHECKED) - {"descriptor"}:
        _see(np.array_equal(getattr(archive, name), held[name][rows]), f"the {name} of an individual has changed")
    _see(
        np.array_equal(archive.rows_of(archive.id), np.arange(len(archive))), "individuals are not found by their ids after it"
    )


def _too_great_a_loss_is_refused(make: Callable[[], Archive]) -> None:
    """redescribe leaves all as it is where fewer would stay than must."""
    archive, twin = _filled(make), _filled(make)
    archive.redescribe(0.5 * archive.descriptor, least=len(archive) + 1)
    _check_same_course(archive, twin, "from before")


def _bad_arguments_change_nothing(make: Callable[[], Archive]) -> None:
    """arguments of a wrong shape are refused by a ValueError, and change nothing."""
    archive, twin = _filled(make), _filled(make)
    batch = _individuals(archive, 4)
    calls = {
        "fitness of another length": lambda: archive.add(**{**batch, "fitness": np.zeros(3)}),
        "descriptors of another dimension": lambda: archive.add(**{**batch, "descriptor": np.zeros((4, 7))}),
        "new descriptors for too few": lambda: archive.redescribe(np.zeros((1, 2))),
        "new descriptors that are NaN": lambda: archive.redescribe(archive.descriptor * np.nan),
    }
    for what, call in calls.items():
        try:
            call()
        except ValueError:
            continue
        raise _Broken(f"{what} were taken")
    _check_same_course(archive, twin, "from before")


def _bad_placements_leave_it_unharmed(make: Callable[[], Archive]) -> None:
    """a placement that makes no sense, or an error in place, leaves it as it was, by reindex."""

    def nonsense(place: Callable[[Columns], Placement], batch: Columns) -> Placement:
        place(batch)
        return Placement(np.ones(batch.rows, np.int8), np.full(batch.rows, -1))

    def failing(place: Callable[[Columns], Placement], batch: Columns) -> Placement:
        place(batch)
        raise ZeroDivisionError

    calls: tuple[Callable[[Archive], Any], ...] = (
        lambda archive: archive.add(**_individuals(archive, 50, 77)),
        lambda archive: archive.redescribe(0.5 * archive.descriptor),
    )
    for bad, call in itertools.product((nonsense, failing), calls):
        archive, twin = _filled(make, 10), _filled(make, 10)  # with room for others
        archive.place = partial(bad, archive.place)  # pyright: ignore[reportAttributeAccessIssue]
        with suppress(ValueError, ZeroDivisionError):
            call(archive)
        del archive.place
        _check_same_course(archive, twin, "from before")


def _it_can_be_saved_and_restored(make: Callable[[], Archive]) -> None:
    """its settings, constants, columns and state are all that it is, the first and the last as JSON values."""
    archive = _filled(make)
    settings, state = json.loads(json.dumps(archive.settings)), json.loads(json.dumps(archive.state))
    again = type(archive).made(settings, archive.constants)
    _see(len(again) == 0, f"one made from its settings holds {len(again)} individuals")
    again.restore(_seen(archive), state)
    _check_same_course(archive, again, "between it and one restored from these")


def _copies_go_their_own_way(make: Callable[[], Archive]) -> None:
    """a deep copy is the same, and what happens to one does not touch the other."""
    archive, untouched = _filled(make), _filled(make)
    twin = copy.deepcopy(archive)
    for seed in (201, 202):
        twin.add(**_individuals(twin, 100, seed))
    twin.redescribe(0.5 * twin.descriptor)
    _check_same(archive, untouched, "from before, once its copy was added to")
    _check_same_course(archive, copy.deepcopy(untouched), "between it and a copy")


def _credit_goes_to_parents(make: Callable[[], Archive]) -> None:
    """credit changes the curiosity of the parents that are stored, by 1 and -0.5, and of no others."""
    archive = _filled(make)
    _see(len(archive) >= 3, f"of 500 individuals {len(archive)} were stored, too few to see it")
    first, second, third = archive.id[:3].tolist()
    expected = archive.curiosity.copy()
    expected[:3] += [2.0, -0.5, -0.5]
    archive.credit([first, first, second, third, -1, 10**9], [NEW, REPLACED, REJECTED, INVALID, NEW, NEW])
    _see(np.array_equal(archive.curiosity, expected), f"it became {shown(archive.curiosity[:3])}")
    held = dict(zip(archive.id.tolist(), archive.curiosity.tolist(), strict=True))
    archive.add(**_individuals(archive, 100, 303))
    for number, curiosity in zip(archive.id.tolist(), archive.curiosity.tolist(), strict=True):
        _see(curiosity == held.get(number, 0.0), f"the curiosity of id {number} changed when others were added")


def _own_columns_follow(make: Callable[[], Archive]) -> None:
    """columns of its own are numbers that go where their individuals go."""
    archive = _filled(make)
    for name, dtype in archive.own.items():
        column = archive.columns.get(name)
        _see(column is not None and column.shape == (len(archive),), f"there is no column {name} of {len(archive)} numbers")
        _see(column is not None and column.dtype == np.dtype(dtype), f"{name} is of another dtype than {np.dtype(dtype)}")
    passive = [name for name in archive.own if not archive.columns[name].any()]  # it does not write to these by itself
    for name in passive:
        archive.writable(name)[:] = (archive.id % 100 + 1).astype(archive.own[name])
    steps = {
        "others were added": lambda: archive.add(**_individuals(archive, 100, 401)),
        "it was redescribed": lambda: archive.redescribe(0.9 * archive.descriptor),
        "still others were added": lambda: archive.add(**_individuals(archive, 100, 402)),
    }
    newest = archive.state["next_id"]
    for what, step in steps.items():
        step()
        for name in passive:
            wanted = np.where(archive.id < newest, archive.id % 100 + 1, 0).astype(archive.own[name])
            _see(np.array_equal(archive.columns[name], wanted), f"{name} is of other individuals when {what}")


_OF_ARCHIVES = (
    _begins_empty,
    _columns_belong_together,
    _columns_cannot_be_written,
    _statuses_and_rows_add_up,
    _ids_are_never_given_twice,
    _the_same_leads_to_the_same,
    _invalid_ones_are_not_stored,
    _redescribing_keeps_individuals,
    _too_great_a_loss_is_refused,
    _bad_arguments_change_nothing,
    _bad_placements_leave_it_unharmed,
    _it_can_be_saved_and_restored,
    _copies_go_their_own_way,
    _credit_goes_to_parents,
    _own_columns_follow,
)


# Emitters


def _evaluated(genotype: np.ndarray) -> dict[str, np.ndarray]:
    """What a task would say of genotypes: a fifth of them are invalid."""
    place = np.stack([genotype.mean(axis=1), genotype[:, 0]], axis=1)
    fitness = np.where((1000 * genotype[:, 0]).astype(int) % 5 == 0, np.nan, -((genotype - 0.4) ** 2).sum(axis=1))
    return {"genotype": genotype, "fitness": fitness, "observation": place, "descriptor": place}


def _start(n_genes: int) -> Archive:
    archive = UnstructuredArchive(l=0.01)
    archive.add(**_evaluated(np.random.default_rng(0).random((100, n_genes))))
    return archive


def _ask(emitter: Any, archive: Archive, n: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    found = emitter.ask(archive, n, np.random.default_rng(seed))
    _see(isinstance(found, tuple) and len(found) == 2, f"ask returned {shown(found)}, and not genotypes and their parents")
    return np.asarray(found[0]), np.asarray(found[1])


def _generation(emitter: Any, archive: Archive, seed: int, n: int = 20) -> None:
    """Ask, add and tell, as `Aurora` does."""
    genotype, parent = _ask(emitter, archive, n, seed)
    batch = Columns({**_evaluated(genotype), "born": np.arange(n), "parent": np.asarray(parent, np.int64)})
    valid = np.isfinite(batch["fitness"])
    info = archive.insert(batch, valid)
    archive.credit(batch["parent"], info.status)
    if hasattr(emitter, "tell"):
        descriptor = np.where(valid[:, None], batch["descriptor"], np.nan)
        emitter.tell(archive, batch | {"descriptor": descriptor}, info)


def _after_some(emitter: Any, n_genes: int) -> tuple[Any, Archive]:
    emitter, archive = copy.deepcopy(emitter), _start(n_genes)
    for seed in _SEEDS:
        _generation(emitter, archive, seed)
    return emitter, archive


def _makes_genotypes(emitter: Any, n_genes: int) -> None:
    """ask gives n genotypes in [0, 1] and n parents that are stored, or -1."""
    emitter, archive = copy.deepcopy(emitter), _start(n_genes)
    for seed, n in enumerate((1, 7, 50)):
        genotype, parent = _ask(emitter, archive, n, seed)
        _see(genotype.shape == (n, n_genes), f"genotypes have shape {genotype.shape}, and not {(n, n_genes)}")
        inside = genotype.dtype.kind == "f" and bool((genotype >= 0).all() and (genotype <= 1).all())
        _see(inside, f"genotypes are {genotype.dtype} from {genotype.min()} to {genotype.max()}")
        _see(parent.shape == (n,) and parent.dtype.kind in "iu", f"parents are {parent.dtype} of shape {parent.shape}")
        strangers = set(parent.tolist()) - set(archive.id.tolist()) - {-1}
        _see(not strangers, f"{shown(strangers)} are parents, and no ids of individuals stored")


def _starts_if_it_says_so(emitter: Any, n_genes: int) -> None:
    """one with a true attribute starts makes genotypes also while nothing is stored."""
    if getattr(emitter, "starts", False):
        genotype, parent = _ask(copy.deepcopy(emitter), UnstructuredArchive(), 5, 0)
        _see(genotype.shape == (5, n_genes) and (parent == -1).all(), f"got shape {genotype.shape}, parents {shown(parent)}")


def _leaves_the_archive_alone(emitter: Any, n_genes: int) -> None:
    """it does not change the archive."""
    emitter, archive = _after_some(emitter, n_genes)
    before, state = _seen(archive), archive.state
    _ask(emitter, archive, 20, 0)
    if hasattr(emitter, "updated"):
        emitter.updated(archive, lambda columns: columns["observation"])
    column = _differ(before, _seen(archive))
    _see(column is None and archive.state == state, f"{column or 'state'} of the archive has changed")


def _the_seed_decides(emitter: Any, n_genes: int) -> None:
    """all that is random comes from the generator that it is given."""
    batches = []
    for _ in range(2):
        again, archive = _after_some(emitter, n_genes)
        batches.append(_ask(again, archive, 20, 9))
    _check_same_batch(batches[0], batches[1], "of two with one seed")


def _invalid_ones_are_told(emitter: Any, n_genes: int) -> None:
    """tell takes a batch of which some, or all, are invalid."""
    if not hasattr(emitter, "tell"):
        return
    emitter, archive = _after_some(emitter, n_genes)
    genotype, parent = _ask(emitter, archive, 10, 0)
    batch = Columns({**_evaluated(genotype), "born": np.arange(10), "parent": parent}) | {"fitness": np.full(10, np.nan)}
    info = archive.insert(batch, np.zeros(10, bool))
    emitter.tell(archive, batch | {"descriptor": np.full((10, 2), np.nan)}, info)
    genotype, _ = _ask(emitter, archive, 10, 1)
    _see(np.isfinite(genotype).all(), "after a batch of invalid individuals its genotypes are not finite")


def _its_state_is_all_it_remembers(emitter: Any, n_genes: int) -> None:
    """state, JSON values and arrays, and restore carry all that it remembers to the next batch."""
    worn, archive = _after_some(emitter, n_genes)
    fresh = copy.deepcopy(emitter)
    if hasattr(worn, "state"):
        state = dict(worn.state())
        arrays = {name: value.copy() for name, value in state.items() if isinstance(value, np.ndarray)}
        values = json.loads(json.dumps({name: value for name, value in state.items() if name not in arrays}))
        fresh.restore({**values, **arrays})
    for seed in (11, 12):
        other = copy.deepcopy(archive)
        _check_same_batch(
            _ask(worn, archive, 20, seed), _ask(fresh, other, 20, seed), "of it and of one restored from its state"
        )
        _generation(worn, archive, seed)
        _generation(fresh, other, seed)


def _check_same_batch(one: tuple[np.ndarray, np.ndarray], other: tuple[np.ndarray, np.ndarray], what: str) -> None:
    for name, left, right in zip(("genotypes", "parents"), one, other, strict=True):
        _see(np.array_equal(left, right), f"the {name} {what} differ")


_OF_EMITTERS = (
    _makes_genotypes,
    _starts_if_it_says_so,
    _leaves_the_archive_alone,
    _the_seed_decides,
    _invalid_ones_are_told,
    _its_state_is_all_it_remembers,
)


# Descriptors


def _observations(seed: int = 0, n: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """And their fitness."""
    rng = np.random.default_rng(seed)
    hidden = rng.normal(size=(n, 3))
    return (hidden @ rng.normal(size=(3, 12)) + 0.1 * rng.normal(size=(n, 12))).reshape(n, 6, 2), hidden[:, 0]


def _descriptor(transformer: Any) -> Descriptor:
    return Descriptor.checked(transformer, np.random.default_rng(0))


def _describes(transformer: Any, _: Sequence[str]) -> None:
    """fitted on observations, it gives each finite numbers, one at least."""
    observation, fitness = _observations()
    values = _descriptor(transformer).refitted(observation, fitness).describe_observation(observation)
    _see(np.isfinite(values).all(), "there is a NaN or an infinity among them")
    _see(np.ptp(values, axis=0).max() > 0, "it maps all observations to one point")


def _arguments_stay(transformer: Any, _: Sequence[str]) -> None:
    """it does not change what it is given."""
    observation, fitness = _observations()
    given = Descriptor("observation").refitted(observation).describe_observation(observation)  # scaled and flat
    fitted = _descriptor(transformer).refitted(observation, fitness)
    for call in (
        fitted.encode,
        *([] if fitted.decode is None or fitted.affine else [lambda x: fitted.decode(fitted.encode(x))]),
    ):
        x = given.copy()
        call(x)
        _see(np.array_equal(x, given), "the observations have changed")


def _fits_alike(transformer: Any, _: Sequence[str]) -> None:
    """with one random_state, the same observations give the same descriptor, and it describes the same each time."""
    observation, fitness = _observations()
    one, other = (_descriptor(transformer).refitted(observation, fitness) for _ in range(2))
    values = one.describe_observation(observation)
    _see(np.array_equal(values, one.describe_observation(observation)), "two descriptions of one observation differ")
    _see(np.array_equal(values, other.describe_observation(observation)), "two that were fitted on the same differ")


def _each_alone(transformer: Any, _: Sequence[str]) -> None:
    """an observation is described the same whatever others are in the batch."""
    observation, fitness = _observations()
    fitted = _descriptor(transformer).refitted(observation, fitness)
    values = fitted.describe_observation(observation)
    apart = np.concatenate([fitted.describe_observation(observation[i : i + 1]) for i in range(0, 60, 7)])
    off = np.abs(apart - values[::7]).max() / max(np.abs(values).max(), 1e-300)
    _see(off < 1e-5, f"alone it differs by {off:.2g} of the largest")


def _refitting_leaves_the_old_one(transformer: Any, _: Sequence[str]) -> None:
    """a copy that is fitted on other observations leaves the old one as it was."""
    observation, fitness = _observations()
    fitted = _descriptor(transformer).refitted(observation, fitness)
    before = fitted.describe_observation(observation)
    fitted.refitted(*_observations(1))
    _see(np.array_equal(before, fitted.describe_observation(observation)), "the old one describes otherwise now")


def _inverse_gives_observations(transformer: Any, _: Sequence[str]) -> None:
    """inverse_transform, if there is one, gives finite observations from descriptors."""
    observation, fitness = _observations()
    fitted = _descriptor(transformer).refitted(observation, fitness)
    if fitted.decode is not None:
        back = fitted.reconstruct(fitted.describe_observation(observation))
        _see(back.shape == observation.shape and np.isfinite(back).all(), f"it gave shape {back.shape}, or no finite numbers")


def _can_be_saved(transformer: Any, trusted: Sequence[str]) -> None:
    """it can be saved and loaded, and describes the same again."""
    observation, fitness = _observations()
    fitted = _descriptor(transformer).refitted(observation, fitness)
    own = f"{type(transformer).__module__}.{type(transformer).__qualname__}"
    assert fitted.scaling is not None  # it is ready
    again = _transformers.loaded(_transformers.dumped(fitted.source), [own, *trusted])
    values = Descriptor(again).restored(fitted.scaling, fitted.shape).describe_observation(observation)
    _see(np.array_equal(values, fitted.describe_observation(observation)), "it describes otherwise")


_OF_DESCRIPTORS = (
    _describes,
    _arguments_stay,
    _fits_alike,
    _each_alone,
    _refitting_leaves_the_old_one,
    _inverse_gives_observations,
    _can_be_saved,
)


# Tasks


def _genotypes(n_genes: int, n: int = 8) -> np.ndarray:
    return np.random.default_rng(0).random((n, n_genes))


def _evaluation(task: Callable[..., Any], genotypes: np.ndarray, first: int = 0) -> dict[str, np.ndarray]:
    """Fitness, each stream of observations, and ground truth if there is one, by what they are called."""
    seeds = other_seeds(0, first + len(genotypes))[first:]
    fitness, observation, truth = evaluated(task, genotypes, seeds, f"of {len(genotypes)} genotypes")
    streams = streams_of(observation)
    observed = {f"observation {name}".removesuffix(" observation"): values for name, values in streams.items()}
    return {"fitness": fitness, **observed, **({} if truth is None else {"ground truth": truth})}


def _check_same_results(one: Mapping[str, np.ndarray], other: Mapping[str, np.ndarray], what: str, off: float = 0.0) -> None:
    for name, values in one.items():
        scale = np.abs(values[np.isfinite(values)], dtype=np.float64).max(initial=0.0)
        same = np.allclose(values, other[name], rtol=0, atol=off * scale, equal_nan=True)
        _see(same, f"the {name} differs {what}")


def _says_how_many_genes(task: Callable[..., Any], n_genes: int) -> None:
    """n_genes and genes, if it has them, speak of as many genes."""
    for said in (getattr(task, "n_genes", n_genes), len(getattr(task, "genes", range(n_genes)))):
        _see(said == n_genes, f"{said} and {n_genes}")


def _returns_rows(task: Callable[..., Any], n_genes: int) -> None:
    """it returns a row for each genotype, of the same shape and dtype for any number of them."""
    kinds = {}
    for n in (1, 2, 7):
        found = _evaluation(task, _genotypes(n_genes, n))
        kinds[n] = {name: (values.dtype.name, values.shape[1:]) for name, values in found.items()}
        _see(kinds[n] == kinds[1], f"of one it returned {shown(kinds[1])}, and of {n} {shown(kinds[n])}")


def _takes_bounds(task: Callable[..., Any], n_genes: int) -> None:
    """it evaluates the lowest and the highest genotypes, 0 and 1."""
    _evaluation(task, np.repeat([[0.0], [1.0]], n_genes, axis=1))


def _leaves_genotypes(task: Callable[..., Any], n_genes: int) -> None:
    """it does not change the genotypes that it is given."""
    genotypes = _genotypes(n_genes)
    _evaluation(task, genotypes)
    _see(np.array_equal(genotypes, _genotypes(n_genes)), "they have changed")


def _results_stay(task: Callable[..., Any], n_genes: int) -> None:
    """what it has returned does not change when it is called again."""
    found = _evaluation(task, _genotypes(n_genes))
    held = {name: values.copy() for name, values in found.items()}
    _evaluation(task, 1 - _genotypes(n_genes), first=20)
    _check_same_results(held, found, "afterwards")


def _does_the_same_again(task: Callable[..., Any], n_genes: int) -> None:
    """one genotype does the same each time; if chance is in it, it says seeded = True, and the seeds decide."""
    one, other = (_evaluation(task, _genotypes(n_genes)) for _ in range(2))
    _check_same_results(one, other, "between two calls")


def _does_the_same_alone(task: Callable[..., Any], n_genes: int) -> None:
    """a genotype does the same whatever others are in the batch, but for rounding."""
    genotypes = _genotypes(n_genes)
    together = _evaluation(task, genotypes)
    for i in range(0, len(genotypes), 3):
        alone = _evaluation(task, genotypes[i : i + 1], first=i)
        _check_same_results({name: values[i : i + 1] for name, values in together.items()}, alone, "alone", 1e-6)


def _behaviours_differ(task: Callable[..., Any], n_genes: int) -> None:
    """two of some hundred random genotypes are valid, and they are observed to do different things."""
    for n in (8, 400):  # a few do for most tasks
        found = _evaluation(task, _genotypes(n_genes, n))
        observed = [values for name, values in found.items() if name.startswith("observation")]
        valid = np.logical_and.reduce([finite_rows(values) for values in (found["fitness"], *observed)])
        if valid.sum() > 1:
            break
    _see(valid.sum() > 1, f"{valid.sum()} of {len(valid)} are valid")
    _see(any((values[valid] != values[valid][:1]).any() for values in observed), "all observations are the same")


_OF_TASKS = (
    _says_how_many_genes,
    _returns_rows,
    _takes_bounds,
    _leaves_genotypes,
    _results_stay,
    _does_the_same_again,
    _does_the_same_alone,
    _behaviours_differ,
)
