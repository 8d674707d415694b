from auroraqd.evaluate._trust import Trust, Worker

A, B, C = Worker("one", 1), Worker("one", 2), Worker("two", 3)


def met(*workers):
    trust = Trust()
    for worker in workers:
        trust.met(worker)
    trust.met_all()
    return trust


def test_three_failures_that_others_do_not_share():
    trust = met(A, B)
    assert trust.succeeded(B, {A}) == trust.succeeded(B, {A}) == []
    assert trust.succeeded(B, {A}) == [A]
    assert trust.succeeded(B, {A}) == []  # it is no news
    assert trust.bad == {A}
    assert trust.elsewhere(()) == {A}


def test_a_success_between_them_clears_it():
    trust = met(A, B)
    for _ in range(5):
        trust.succeeded(B, {A})
        assert trust.succeeded(B, {A}) == []
        trust.succeeded(A, ())
    assert trust.succeeded(A, {A}) == []  # on itself, the second time
    assert not trust.bad


def test_when_all_are_bad_it_is_not_the_workers():
    trust = met(A, B)
    for one, other in ((A, B), (B, A)):
        for _ in range(3):
            trust._unshared[one] += 1
        trust._convict([one])
        assert trust.bad == ({A} if other == B else set())


def test_elsewhere_is_another_host_if_there_is_one():
    assert met(A, B).elsewhere({A}) == {A}
    assert met(A, B, C).elsewhere({A}) == {"one"}
    assert B.among({"one"})
    assert not C.among({"one", A})


def test_there_is_no_elsewhere_if_it_failed_everywhere():
    assert met(A, B).elsewhere({A, B}) == met(A).elsewhere({A}) == frozenset()
    trust = met(A)
    trust.met(B)  # so there may be more
    assert trust.elsewhere({A, B}) == {A, B}


def test_a_bad_worker_is_no_elsewhere_either():
    trust = met(A, B)
    for _ in range(3):
        trust.succeeded(B, {A})
    assert trust.elsewhere({B}) == trust.elsewhere({A, B}) == {A}


def test_those_that_are_gone_are_not_accused():
    trust = met(B, C)
    assert all(trust.succeeded(B, {A}) == [] for _ in range(5))


def test_a_worker_that_cannot_load_the_task():
    trust = met(A, B)
    assert trust.refused(A) == [A]
    assert trust.refused(A) == []
